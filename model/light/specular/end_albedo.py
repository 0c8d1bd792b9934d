# SPDX-License-Identifier: GPL-3.0-or-later
"""Mean albedo at the ends of specular paths: pixels show more of a texture than a point, which alone would be noise."""
from __future__ import annotations

import numpy as np

from ...geometry import area_vectors, barycentric, dot
from ...scene import BASE_COLOR, RenderScene, texels
from ...shading import clipped

ALIKE = 0.9    # cosine between normals of the ends of two paths on the same surface, at least
ASIDE = 0.2    # how far one is above the plane of the other, of the way between them, at most
EVEN = 0.02    # differences between the colours of a tile that are not seen
SIDE = 4       # points along either side of a pixel, of which the mean is taken


def mean_albedo(scene: RenderScene, row: np.ndarray, column: np.ndarray, position: np.ndarray, normal: np.ndarray,
                triangle: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """(P, 3) f32 mean of the `albedo` (P, 3) within pixels at which P paths start, in (P,) rows and columns.

    They end at positions with unit normals (P, 3), facing them, on triangles (P,) of the geometry, -1 for what has no
    albedo. How much of it a pixel shows is told by the paths of the next ones.
    """
    step = _steps(row, column, position, normal, triangle >= 0)
    tile = _tiles(scene, triangle, normal)
    used, number = np.unique(tile, return_inverse=True)
    is_textured = np.ptp(scene.tiles[used][:, BASE_COLOR], axis=(2, 3)).max(axis=1) > EVEN
    some = np.flatnonzero((triangle >= 0) & is_textured[number] & step.any(axis=(1, 2)))
    corners, mean = scene.triangles[scene.surfaces.token[triangle[some]]], albedo.copy()
    middle, down, right = (np.float32(barycentric(corners, position[some] + way)) for way in (
        0, step[some, 0], step[some, 1]))
    offsets = (np.arange(SIDE) + 0.5) / SIDE - 0.5
    mean[some] = sum(_albedo_at(scene, tile[some], middle + y * (down - middle) + x * (right - middle))
                     for y in np.float32(offsets) for x in np.float32(offsets)) / SIDE ** 2
    return mean


def _albedo_at(scene: RenderScene, tile: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(P, 3) of tiles (P,) at weights (P, 3) of corners, which may be beside the triangle."""
    x, y = texels(clipped(weights)[:, :2])
    return scene.tiles[tile[:, None], np.r_[BASE_COLOR], y[:, None], x[:, None]].astype(np.float32)


def _tiles(scene: RenderScene, triangle: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(P,) the tile of each triangle (P,), on the side of a normal (P, 3)."""
    is_behind = dot(area_vectors(scene.surfaces.triangles[triangle]), normal) < 0
    return scene.tiles_met(scene.surfaces.token[triangle], is_behind)


def _steps(row: np.ndarray, column: np.ndarray, position: np.ndarray, normal: np.ndarray,
           has_end: np.ndarray) -> np.ndarray:
    """(P, 2, 3) from the end of a path to those of the next pixels' paths, down and right, on the same surface.

    The mean of both sides, if there are two; 0 where there is none.
    """
    number = np.full((row.max(initial=0) + 3, column.max(initial=0) + 3), -1)
    number[row + 1, column + 1] = np.where(has_end, np.arange(len(row)), -1)
    steps = np.zeros((len(row), 2, 3), np.float32)
    for axis, (down, right) in enumerate(((1, 0), (0, 1))):
        count = np.zeros(len(row), np.float32)
        for side in (1, -1):
            other = number[row + 1 + side * down, column + 1 + side * right]
            way = position[other] - position
            is_same = (other >= 0) & has_end & (dot(normal[other], normal) > ALIKE) & (
                np.abs(dot(way, normal)) <= ASIDE * np.linalg.norm(way, axis=1))
            steps[is_same, axis] += side * way[is_same]
            count += is_same
        steps[:, axis] /= count.clip(1)[:, None]
    return steps
