# SPDX-License-Identifier: GPL-3.0-or-later
"""Image Texture and Environment Texture."""
from __future__ import annotations

import numpy as np

from ....model.geometry import latlong_uv
from ..data.arrays import divide_safely, join, length
from ..data.images import FIRST_TILE, MISSING, TILES_IN_A_ROW, Pyramid, sample
from .coordinates import active_uv
from .node_call import NodeCall
from .normal_map import UP


def image_texture(n: NodeCall):
    node, vector = n.node, n.linked("Vector")
    if node.image.source == "MOVIE":
        n.bake_or_report("of a movie estimated light sees one frame: render it to an image sequence")
    if vector is None:
        vector = active_uv(n) if n.points.direction is None else n.points.direction
    if node.projection == "BOX" and n.points.corners is not None:
        normal = n.points.normal
        weights = box_weights(normal, node.projection_blend)
        sides = zip(on_box(*np.broadcast_arrays(vector, normal)), np.split(weights, 3, axis=-1), strict=True)
        texels = sum(_look_up(n, uv) * weight for uv, weight in sides)
    else:
        texels = _look_up(n, {"SPHERE": on_ball, "TUBE": on_tube}.get(node.projection, lambda uv: uv)(vector))
    return texels[..., 3:] if n.output.name == "Alpha" else texels[..., :3]


def _look_up(n: NodeCall, uv: np.ndarray) -> np.ndarray:
    """(..., 4) at (..., 2+)."""
    node = n.node
    if node.image.source != "TILED":
        return _prefiltered(_pyramid(n), uv, n)
    column, row = np.moveaxis(np.floor(np.nan_to_num(_shown(n, uv)[..., :2])), -1, 0)
    in_rows = (column >= 0) & (column < TILES_IN_A_ROW) & (row >= 0)
    tile, result = np.where(in_rows, FIRST_TILE + column + TILES_IN_A_ROW * row, FIRST_TILE), MISSING
    for number in np.intersect1d(tile, list(node.image.pyramids)).astype(int).tolist():
        origin = divmod(number - FIRST_TILE, TILES_IN_A_ROW)[::-1]
        texels = _prefiltered(_pyramid(n, number), uv[..., :2] - np.float32(origin), n)
        result = np.where((tile == number)[..., None], texels, result)
    return np.broadcast_to(result, tile.shape + (4,))


def _shown(n: NodeCall, uv: np.ndarray) -> np.ndarray:
    """The coordinates among (..., 2+) at which texels are read."""
    return uv[:, :1, :1] if n.points.first_alone and uv.ndim == 4 else uv


def _prefiltered(pyramid, uv: np.ndarray, n: NodeCall) -> np.ndarray:
    """Each triangle (first axis of a (m, r, c, 2+) uv) reads the level whose texels match its own grid step."""
    shown, how = _shown(n, uv), (n.node.extension, n.node.interpolation)
    if uv.ndim != 4:
        return pyramid.at(shown, 0, *how)
    level, out = _levels(uv, pyramid.shape), np.empty(shown.shape[:3] + (4,), np.float32)
    for index in np.unique(level):
        chosen = level == index
        out[chosen] = pyramid.at(shown[chosen], index, *how)
    return out


def _levels(uv: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(m,); 0 of single points."""
    if uv.shape[1:3] == (1, 1):
        return np.zeros(len(uv), int)
    size = np.float32(shape[::-1])
    steps = np.stack([uv[:, 0, 1] - uv[:, 0, 0], uv[:, 1, 0] - uv[:, 0, 0]], axis=1)[..., :2] * size
    texels = np.linalg.norm(steps, axis=-1).max(axis=1)
    return np.clip(np.round(np.log2(np.maximum(np.nan_to_num(texels), 1))), 0, 15).astype(int)


def environment_texture(n: NodeCall):
    """Latitude-longitude or mirror-ball lookup of a direction (docs/scene-input.md 7.1)."""
    direction, level = n.linked("Vector"), 0
    direction = n.points.direction if direction is None else direction
    if direction is None:
        n.approximated("an Environment Texture on a surface is replaced by its mean color")
        direction, level = UP, 16
    pixels = _pyramid(n).level(level)
    direction = direction / np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-12)
    if n.node.projection == "MIRROR_BALL":
        x, y, z = np.moveaxis(direction, -1, 0)
        length = np.sqrt(np.maximum(x * x + (y - 1) ** 2 + z * z, 1e-12))
        uv = np.stack([0.5 * (x / length + 1), 0.5 * (z / length + 1)], axis=-1)
    else:
        uv = latlong_uv(direction)
    return sample(pixels, uv, "REPEAT")[..., :3]  # Cycles repeats it across the poles too


def on_ball(vector: np.ndarray) -> np.ndarray:
    """(..., 2) of coordinates (..., 3) in a box from 0 to 1."""
    direction = 2 * vector - 1
    size = length(direction)
    return join(_around(direction), 1 - np.arccos(np.clip(divide_safely(direction[..., 2:], size), -1, 1)) / np.pi)


def on_tube(vector: np.ndarray) -> np.ndarray:
    direction = 2 * vector - 1
    is_off_axis = np.hypot(direction[..., :1], direction[..., 1:2]) > 0
    return join(_around(direction), (direction[..., 2:] + 1) / 2) * is_off_axis


def _around(direction: np.ndarray) -> np.ndarray:
    x, y = direction[..., :1], direction[..., 1:2]
    return np.where((x == 0) & (y == 0), 0, (1 - np.arctan2(x, y) / np.pi) / 2)


def on_box(vector: np.ndarray, normal: np.ndarray) -> list[np.ndarray]:
    """(..., 2) each, for the sides along x, y and z, of the object's normal (..., 3)."""
    x, y, z = np.split(vector, 3, axis=-1)
    nx, ny, nz = np.split(normal, 3, axis=-1)
    return [join(np.where(nx < 0, 1 - y, y), z), join(np.where(ny > 0, 1 - x, x), z),
            join(np.where(nz > 0, 1 - y, y), x)]


def box_weights(normal: np.ndarray, blend: float) -> np.ndarray:
    """(..., 3) how much each side of a box shows where the surface has this normal."""
    size = np.abs(normal)
    size = divide_safely(size, size.sum(axis=-1, keepdims=True))
    limit = (1 + blend) / 2
    weights = np.zeros_like(size)
    remaining = np.ones(size.shape[:-1], bool)
    for axis in range(3):  # one side alone
        others = [size[..., other] for other in range(3) if other != axis]
        alone = remaining & np.logical_and(*(size[..., axis] > limit * (size[..., axis] + other) for other in others))
        weights[alone, axis] = 1
        remaining &= ~alone
    if blend == 0:
        weights[remaining, 0] = 1
        return weights
    for last, first, second in ((2, 0, 1), (0, 1, 2), (1, 0, 2)):  # two sides
        pair = size[..., first] + size[..., second]
        both = remaining & (size[..., last] < (1 - limit) * pair)
        share = np.clip((divide_safely(size[..., first], pair) - (1 - blend) / 2) / blend, 0, 1)
        weights[both, first], weights[both, second] = share[both], 1 - share[both]
        remaining &= ~both
    weights[remaining] = ((2 - limit) * size[remaining] + (limit - 1)) / (2 * limit - 1)
    return weights


def _pyramid(n: NodeCall, tile: int | None = None) -> Pyramid:
    """One magenta texel, which is reported, where there are no pixels."""
    if tile in n.node.image.missing:
        n.simplified(n.node.image.missing[tile])
    return n.node.image.pyramids[tile]


FUNCTIONS = {"ShaderNodeTexImage": image_texture, "ShaderNodeTexEnvironment": environment_texture}
