# SPDX-License-Identifier: GPL-3.0-or-later
"""Image Texture and Environment Texture."""
from __future__ import annotations

import numpy as np

from ....model.geometry import latlong_uv
from .coordinates import active_uv
from .image import sample
from .node_call import NodeCall
from .normal_map import UP


def image_texture(n: NodeCall):
    node, uv = n.node, n.linked("Vector")
    if uv is None:
        uv = active_uv(n) if n.points.direction is None else n.points.direction
    if node.projection != "FLAT":
        n.approximated(f"{node.projection.title()} projection is evaluated as Flat on the UV map")
    straight = node.outputs["Alpha"].is_linked  # Cycles hands out straight colours only when alpha is used as well
    pyramid = n.images.pyramid(node.image, n.evaluator.owner, premultiply=not straight)
    found = _prefiltered(pyramid, uv, node.extension, node.interpolation == "Closest")
    return found[..., 3:] if n.output.name == "Alpha" else found[..., :3]


def _prefiltered(pyramid, uv, extension, closest):
    """Each triangle (first axis of a (m, 32, 32, 3) uv) reads the level whose texels match its own grid step."""
    if uv.ndim != 4:
        return sample(pyramid.level(0), uv, extension, closest)
    rows, columns = pyramid.level(0).shape[:2]
    size = np.array([columns, rows], np.float32)
    steps = np.stack([uv[:, 0, 1] - uv[:, 0, 0], uv[:, 1, 0] - uv[:, 0, 0]], axis=1)[..., :2] * size
    texels = np.linalg.norm(steps, axis=-1).max(axis=1)
    level = np.clip(np.round(np.log2(np.maximum(texels, 1))), 0, 15).astype(int)
    out = np.empty(uv.shape[:3] + (4,), np.float32)
    for index in np.unique(level):
        chosen = level == index
        out[chosen] = sample(pyramid.level(index), uv[chosen], extension, closest and index == 0)
    return out


def environment_texture(n: NodeCall):
    """Latitude-longitude or mirror-ball lookup of a direction (docs/scene-input.md 7.1)."""
    direction, level = n.linked("Vector"), 0
    direction = n.points.direction if direction is None else direction
    if direction is None:
        n.approximated("an environment texture on a surface needs directions, its average is used")
        direction, level = UP, 16
    pixels = n.images.pyramid(n.node.image, n.evaluator.owner, premultiply=True).level(level)
    direction = direction / np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-12)
    if n.node.projection == "MIRROR_BALL":
        x, y, z = np.moveaxis(direction, -1, 0)
        length = np.sqrt(np.maximum(x * x + (y - 1) ** 2 + z * z, 1e-12))
        uv = np.stack([0.5 * (x / length + 1), 0.5 * (z / length + 1)], axis=-1)
    else:
        uv = latlong_uv(direction)
    return sample(pixels, uv, "REPEAT")[..., :3]  # Cycles repeats it across the poles too


FUNCTIONS = {"ShaderNodeTexImage": image_texture, "ShaderNodeTexEnvironment": environment_texture}
