# SPDX-License-Identifier: GPL-3.0-or-later
"""Patterns without noise's lattice: Checker, Gradient, Brick, Magic and Wave Texture."""
from __future__ import annotations

import numpy as np

from ..data.arrays import join, length, mix_values, smoothstep
from .node_call import NodeCall
from .noise.fractal import Fractal, fbm

INWARD, AWAY = np.float32(0.999999), np.float32(1e-6)  # points on whole coordinates belong to one side
TURN = 2 * np.pi
FINE = 0.05  # cells of a checker that a pixel covers, from which on it shows their mean


def checker(n: NodeCall):
    at = n.coordinates() * n["Scale"] * INWARD + AWAY
    width = n.points.widths(at)
    if width is None:
        first = (np.floor(at).sum(axis=-1, keepdims=True) % 2 == 1).astype(np.float32)
    else:
        first = (1 - np.prod(_mean_of_stripes(at, width), axis=-1, keepdims=True)) / 2
    return first if n.output.name in ("Fac", "Factor") else n["Color1"] * first + n["Color2"] * (1 - first)


def _mean_of_stripes(x, width):
    """Mean over a width around x of stripes of 1 and -1 between whole numbers."""
    is_fine = width > FINE
    width = np.where(is_fine, width, 1)
    ends = (1 - np.abs((x + side * width / 2) % 2 - 1) for side in (1, -1))  # of the integral
    return np.where(is_fine, np.subtract(*ends) / width, 1 - 2 * (np.floor(x) % 2))


def gradient(n: NodeCall):
    at = n.coordinates()
    x, y, _ = np.split(at, 3, axis=-1)
    ball = np.maximum(1 - length(at), 0)
    values = {"LINEAR": x, "QUADRATIC": np.maximum(x, 0) ** 2, "EASING": smoothstep(x), "DIAGONAL": (x + y) / 2,
              "RADIAL": np.arctan2(y, x) / TURN + 0.5, "SPHERICAL": ball, "QUADRATIC_SPHERE": ball * ball}
    return np.clip(values[n.node.gradient_type], 0, 1)


def brick(n: NodeCall):
    node = n.node
    x, y, _ = np.split((n.coordinates() * n["Scale"]).astype(np.float32), 3, axis=-1)
    width, height, mortar, smooth = (n[name] for name in ("Brick Width", "Row Height", "Mortar Size", "Mortar Smooth"))
    row = np.floor(y / height)
    if node.offset_frequency and node.squash_frequency:
        width = width * np.where(row % node.squash_frequency, 1, node.squash)
        x = x + np.where(row % node.offset_frequency, 0, width * node.offset)
    column = np.floor(x / width)
    x, y = x - width * column, y - height * row
    inside = np.minimum(np.minimum(x, width - x), np.minimum(y, height - y))
    soft = np.where(smooth > 0, smoothstep((1 - inside / mortar) / np.where(smooth > 0, smooth, 1)), 1)
    seam = np.where(inside >= mortar, 0, soft)
    if n.output.name in ("Fac", "Factor"):
        return seam
    tint = np.clip(_of_brick(row.astype(np.int64), column.astype(np.int64)) + n["Bias"], 0, 1)
    return mix_values(mix_values(n["Color1"], n["Color2"], tint), n["Mortar"], seam)


def _of_brick(row, column) -> np.ndarray:
    """A number from 0 to 1 for each brick: the integer noise of Hugo Elias, over 31 bits."""
    low = np.uint32(0x7fffffff)
    seed = ((row << 16) + (column & 0xffff) + 1013).astype(np.uint32) & low
    seed = (seed >> np.uint32(13)) ^ seed
    bits = (seed * (seed * seed * np.uint32(60493) + np.uint32(19990303)) + np.uint32(1376312589)) & low
    return 0.5 * bits.astype(np.float32) / np.float32(1 << 30)


MAGIC = (  # what replaces x, y or z in turn
    (1, lambda x, y, z: -np.cos(x - y + z)), (0, lambda x, y, z: np.cos(x - y - z)),
    (2, lambda x, y, z: np.sin(-x - y - z)), (0, lambda x, y, z: -np.cos(-x + y - z)),
    (1, lambda x, y, z: -np.sin(-x + y + z)), (1, lambda x, y, z: -np.cos(-x + y + z)),
    (0, lambda x, y, z: np.cos(x + y + z)), (2, lambda x, y, z: np.sin(x + y - z)),
    (0, lambda x, y, z: -np.cos(-x - y + z)), (1, lambda x, y, z: -np.sin(x - y + z)))


def magic(n: NodeCall):
    at, distortion, depth = n.coordinates() * n["Scale"] % np.float32(TURN), n["Distortion"], n.node.turbulence_depth
    x, y, z = np.split(at, 3, axis=-1)
    waves = [np.sin((x + y + z) * 5), np.cos((-x + y - z) * 5), -np.cos((-x - y + z) * 5)]
    if depth:
        waves = [value * distortion for value in waves]
    for target, function in MAGIC[:depth]:
        waves[target] = function(*waves) * distortion
    waves = [0.5 - value / np.where(distortion != 0, 2 * distortion, 1) for value in waves]
    color = join(*waves)
    return color.mean(axis=-1, keepdims=True) if n.output.name in ("Fac", "Factor") else color


BANDS = {"X": (20, 0, 0), "Y": (0, 20, 0), "Z": (0, 0, 20), "DIAGONAL": (10, 10, 10)}
RINGS = {"X": (0, 1, 1), "Y": (1, 0, 1), "Z": (1, 1, 0), "SPHERICAL": (1, 1, 1)}


def wave(n: NodeCall):
    node, at = n.node, (n.coordinates() * n["Scale"] + AWAY) * INWARD
    if node.wave_type == "BANDS":
        phase = at @ np.float32(BANDS[node.bands_direction])[:, None]
    else:
        phase = 20 * length(at * np.float32(RINGS[node.rings_direction]))
    phase, distortion = phase + n["Phase Offset"], n["Distortion"]
    if np.any(distortion != 0):
        fractal = Fractal(n["Detail"][..., 0], n["Detail Roughness"][..., 0], np.float32(2))
        phase = phase + distortion * (2 * fbm(at * n["Detail Scale"], fractal)[..., None] - 1)
    if node.wave_profile == "SIN":
        return 0.5 + 0.5 * np.sin(phase - np.pi / 2)
    turns = phase / TURN
    return turns - np.floor(turns) if node.wave_profile == "SAW" else 2 * np.abs(turns - np.floor(turns + 0.5))


FUNCTIONS = {"ShaderNodeTexChecker": checker, "ShaderNodeTexGradient": gradient, "ShaderNodeTexBrick": brick,
             "ShaderNodeTexMagic": magic, "ShaderNodeTexWave": wave}
