# SPDX-License-Identifier: GPL-3.0-or-later
"""The share of each voxel of a box that is inside a closed mesh."""
from __future__ import annotations

import functools

import numpy as np

from ....model import progress

COLUMNS = 2                     # along each side of a voxel
OFFSET = np.array([0.13, 0.27])  # of a column off its middle, in columns, so that few run along a regular mesh's edges
DIGITS = 5                      # of positions in the box
CHUNK = 1 << 20                 # columns and triangles that may meet, at once


def fill_voxels(corners: np.ndarray, resolution: int) -> np.ndarray:
    """(r, r, r) f32 of a box from -0.5 to 0.5, [x, y, z]; corners: (n, 3, 3) of triangles.

    Columns along z are cut at each crossing of the mesh: what lies after an odd number of them is inside.
    """
    return _filling(np.float32(corners.round(DIGITS)).tobytes(), resolution)


@functools.lru_cache(maxsize=64)
def _filling(corners: bytes, resolution: int) -> np.ndarray:
    """`fill_voxels`, computed once for all instances of a mesh."""
    corners = np.frombuffer(corners, np.float32).astype(np.float64).reshape(-1, 3, 3)
    fine = resolution * COLUMNS
    column, height = _crossings((corners + 0.5) * (fine, fine, resolution) - (*OFFSET, 0), fine)
    order = np.lexsort((height, column))
    column, height = column[order], height[order].clip(0, resolution)
    first = np.searchsorted(column, column)  # of the same column
    rank = np.arange(len(column)) - first
    last = np.searchsorted(column, column, side="right") - first
    closed = rank < last - last % 2          # an open mesh ends where it was last left
    sign = np.where(rank % 2, -1.0, 1.0)[closed]
    column, height = column[closed], height[closed]
    voxel = np.minimum(height.astype(np.int64), resolution - 1)
    steps = np.zeros(fine * fine * (resolution + 1))
    at = column * (resolution + 1) + voxel
    steps += np.bincount(at, sign * (voxel + 1 - height), len(steps))
    steps += np.bincount(at + 1, sign * (height - voxel), len(steps))
    share = steps.reshape(resolution, COLUMNS, resolution, COLUMNS, resolution + 1).cumsum(axis=-1)[..., :resolution]
    return share.mean(axis=(1, 3)).clip(0, 1).astype(np.float32)


def _crossings(corners: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Index x * columns + y of columns, and height (k,), where these cross triangles (n, 3, 3); columns are at whole
    numbers plus one half."""
    extremes = np.stack([corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)])
    low, high = np.ceil(extremes - 0.5).clip(0, columns).astype(np.int64)
    wide, deep = (high - low).T
    candidates = wide * deep
    crossings = [(np.zeros(0, np.int64), np.zeros(0))]
    for group in np.split(np.arange(len(corners)), np.flatnonzero(np.diff(np.cumsum(candidates) // CHUNK)) + 1):
        progress.report()
        count = candidates[group]
        triangle, number = np.repeat(group, count), np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        x, y = low[triangle, 0] + number // deep[triangle], low[triangle, 1] + number % deep[triangle]
        a, b, c = corners[triangle].swapaxes(0, 1)
        columns_xy = np.stack([x + 0.5, y + 0.5], axis=-1)
        weights = np.stack([_area(b, c, columns_xy), _area(c, a, columns_xy), _area(a, b, columns_xy)], axis=-1)
        area = weights.sum(axis=-1)
        hit = ((weights >= 0).all(axis=-1) | (weights <= 0).all(axis=-1)) & (area != 0)
        heights = (weights[hit] * corners[triangle[hit], :, 2]).sum(axis=-1) / area[hit]
        crossings.append((x[hit] * columns + y[hit], heights))
    return np.concatenate([f[0] for f in crossings]), np.concatenate([f[1] for f in crossings])


def _area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed area of triangles seen along z."""
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
