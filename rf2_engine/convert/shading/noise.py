# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise Texture: sums of Perlin's gradient noise (Perlin 2002) over lattice points hashed as Blender does (Jenkins)."""
from __future__ import annotations

import numpy as np

from ....model import progress
from .node_call import NodeCall

RANGE = 0.982  # Blender scales gradient noise in space by this, so that it stays within -1 and 1
MOST_OCTAVES = 15
BLOCK = 1 << 13  # points at once: what fits into the processor's cache
_EDGES = [(1, 1, 0), (-1, 1, 0), (1, -1, 0), (-1, -1, 0), (1, 0, 1), (-1, 0, 1), (1, 0, -1), (-1, 0, -1),
          (0, 1, 1), (0, -1, 1), (0, 1, -1), (0, -1, -1), (1, 1, 0), (0, -1, 1), (-1, 1, 0), (0, -1, -1)]
GRADIENTS = np.array(_EDGES, np.float32).T.copy()  # (3, 16), by the last four bits of a hash
TURNS = (14, 11, 25, 16, 4, 14, 24)  # of the final mix of Jenkins' lookup3


def noise_texture(n: NodeCall):
    node = n.node
    if node.noise_dimensions != "3D":
        n.approximated(f"{node.noise_dimensions} noise is evaluated in 3D: another pattern of the same kind")
    if getattr(node, "noise_type", "FBM") != "FBM":
        n.approximated(f"{node.noise_type.replace('_', ' ').title()} is evaluated as fBM")
    vector, scale = n.coordinates(), n.get("Scale")
    if node.noise_dimensions in ("1D", "4D"):
        vector = (0 if node.noise_dimensions == "1D" else vector) + n.get("W") * np.float32([0, 0, 1])
    detail, roughness, lacunarity, distortion = (
        float(np.mean(n.get(name, default))) for name, default in (
            ("Detail", 2), ("Roughness", 0.5), ("Lacunarity", 2), ("Distortion", 0)))
    at = (vector * scale).astype(np.float32)
    if distortion:
        at = at + distortion * np.stack([perlin(at + _offset(seed)) for seed in range(3)], axis=-1)
    normalized = getattr(node, "normalize", True)
    seeds = (None, 3, 4) if n.output.type == "RGBA" else (None,)
    return np.stack([fractal(at if seed is None else at + _offset(seed), detail, max(roughness, 0), lacunarity,
                             normalized) for seed in seeds], axis=-1)


def fractal(at: np.ndarray, detail: float, roughness: float, lacunarity: float, normalized: bool) -> np.ndarray:
    """Octaves of noise at points (..., 3) -> (...); a fraction of `detail` blends the last one in."""
    detail = float(np.clip(detail, 0, MOST_OCTAVES))
    total, amplitude, weight, frequency = np.float32(0), 1.0, 0.0, 1.0
    for octave in range(int(detail) + 2):
        share = 1.0 if octave <= int(detail) else detail - int(detail)
        if share == 0:
            break
        if at.ndim > 1:
            progress.report()
        more, weight_with = total + amplitude * perlin(at * np.float32(frequency)), weight + amplitude
        if octave <= int(detail):
            total, weight = more, weight_with
            amplitude, frequency = amplitude * roughness, frequency * lacunarity
        elif normalized:
            return ((1 - share) * total / weight + share * more / weight_with) / 2 + 0.5
        else:
            total = (1 - share) * total + share * more
    return total / weight / 2 + 0.5 if normalized else total


def perlin(at: np.ndarray) -> np.ndarray:
    """Gradient noise, -1 to 1, at points (..., 3) f32 -> (...) f32."""
    points = np.nan_to_num(np.fmod(at, np.float32(100_000))).reshape(-1, 3).T
    blocks = [_perlin(np.ascontiguousarray(points[:, i:i + BLOCK])) for i in range(0, points.shape[1], BLOCK)]
    return np.concatenate(blocks).reshape(at.shape[:-1])


def _perlin(points: np.ndarray) -> np.ndarray:
    """(3, m) -> (m,)."""
    cell = np.floor(points)
    part = points - cell
    cell = cell.astype(np.int64)
    smooth = part * part * part * (part * (part * 6 - 15) + 10)
    sides = np.stack([part, 1 - smooth]), np.stack([part - 1, smooth])  # way to the lattice point and its weight
    low = cell.min(axis=1)
    extent = cell.max(axis=1) - low + 2
    few = np.prod(extent, dtype=float) <= 4 * points.shape[1]  # then every lattice point is hashed only once
    if few:
        table = hashed(*(low[:, None, None, None] + np.indices(extent))).ravel()
        first = np.ravel_multi_index(cell - low[:, None], extent)
    result = np.zeros(points.shape[1], np.float32)
    for corner in np.ndindex(2, 2, 2):
        if few:
            kind = table[first + np.ravel_multi_index(corner, extent)]
        else:
            kind = hashed(*(cell + np.array(corner)[:, None]))
        (x, fade_x), (y, fade_y), (z, fade_z) = (sides[side][:, axis] for axis, side in enumerate(corner))
        slope = GRADIENTS[0].take(kind) * x + GRADIENTS[1].take(kind) * y + GRADIENTS[2].take(kind) * z
        result += slope * (fade_x * fade_y * fade_z)
    return RANGE * result


def hashed(x, y, z) -> np.ndarray:
    """Last four bits of the hash of integer lattice points."""
    return _jenkins(x, y, z) & 15


def _jenkins(*keys) -> np.ndarray:
    """Jenkins' lookup3 of two or three integers, as u32."""
    start = np.uint32(0xdeadbeef + 4 * len(keys) + 13)
    words = [np.asarray(key).astype(np.uint32) + start for key in keys] + [start] * (3 - len(keys))
    words = [np.array(np.broadcast_to(word, words[0].shape)) for word in words]
    for i, turn in enumerate(TURNS):
        target, source = words[(2, 0, 1)[i % 3]], words[(1, 2, 0)[i % 3]]
        target ^= source
        target -= (source << np.uint32(turn)) | (source >> np.uint32(32 - turn))
    return words[2]


def _offset(seed: int) -> np.ndarray:
    """(3,) f32 between 100 and 200, by which Blender moves a noise to get another one."""
    bits = np.float32([seed, 0, 1, 2]).view(np.uint32)
    return (100 + 100 * (_jenkins(np.repeat(bits[:1], 3), bits[1:]) / 0xffffffff)).astype(np.float32)


FUNCTIONS = {"ShaderNodeTexNoise": noise_texture}
