# SPDX-License-Identifier: GPL-3.0-or-later
"""Resample grids of numbers to the voxels of a box."""
from __future__ import annotations

import numpy as np

from ..data.copied import Grid
from ..data.medium import Box, voxel_centres

ALIGNED = 1e-6  # of an axis' length may point elsewhere


def in_box(grid: Grid, box: Box, resolution: int) -> np.ndarray:
    """(r, r, r, c) f32 in the box's voxels: means of fine grids, coarse ones interpolated; 0 outside."""
    to_grid = np.linalg.pinv(grid.to_space)
    axes = to_grid[:3, :3] @ (box.rotation * box.size)  # columns: ways through the grid along the box's sides
    straight = np.diag(axes)
    if np.abs(axes - np.diag(straight)).max() > ALIGNED * np.abs(straight).min():
        points = voxel_centres(box, resolution) @ to_grid[:3, :3].T + to_grid[:3, 3]
        return _trilinear(grid.values, points - 0.5)
    first, values = to_grid[:3, :3] @ box.center + to_grid[:3, 3] - straight / 2, grid.values
    for axis in range(3):
        weights = shares(first[axis], straight[axis] / resolution, resolution, values.shape[axis])
        values = np.moveaxis(np.tensordot(weights, values, (1, axis)), 0, axis)
    return values.astype(np.float32)


def shares(first: float, step: float, count: int, size: int) -> np.ndarray:
    """(count, size) what intervals one step wide, from `first` on, take of each value."""
    edges, value = first + step * np.arange(count + 1), np.arange(size)
    if abs(step) < 1:
        middle = (edges[:-1, None] + edges[1:, None]) / 2
        return np.clip(1 - np.abs(middle - value - 0.5), 0, None)
    low = np.minimum(edges[:-1], edges[1:])[:, None]
    high = np.maximum(edges[:-1], edges[1:])[:, None]
    return np.clip(np.minimum(high, value + 1) - np.maximum(low, value), 0, None) / abs(step)


def _trilinear(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(..., c) `values` (x, y, z, c) at fractional indices (..., 3); 0 outside."""
    padded = np.pad(values, ((1, 1),) * 3 + ((0, 0),))
    at = np.clip(at + 1, 0, np.array(padded.shape[:3]) - 1.001)
    base = at.astype(np.int64)
    part, result = at - base, 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, part, 1 - part).prod(axis=-1, keepdims=True)
        result = result + weight * padded[tuple(np.moveaxis(base + corner, -1, 0))]
    return result.astype(np.float32)
