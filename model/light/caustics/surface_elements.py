# SPDX-License-Identifier: GPL-3.0-or-later
"""Small parts of the surfaces near photons, by which their area is measured."""
from __future__ import annotations

import numpy as np

from ...clusters import cell_index, group_key
from ...geometry import area_vectors

MOST = 1 << 18  # elements; of more, some are drawn by their area
HALVES = 8      # square of the longest edge of parts, over their mean area


def near_photons(corners: np.ndarray, position: np.ndarray, reach: float) -> np.ndarray:
    """(M, 3, 3) parts of triangles (G, 3, 3) that are about `reach` or less from photons (N, 3), no longer than that.

    Ground that reaches to the horizon is divided in halves where photons are, and nowhere else.
    """
    is_long = _edges(corners).max(axis=1, initial=0) > reach
    parts, extent = corners[is_long], np.abs(corners).max(initial=reach)
    for level in reversed(range(int(np.ceil(np.log2(extent / reach))) + 1)):
        parts = _beside(_divided(parts, reach * 2 ** level), position, reach * 2 ** level)
    return np.concatenate([parts, _beside(corners[~is_long], position, reach)])


def near_many_photons(parts: np.ndarray, position: np.ndarray, apart: float, reach: float) -> np.ndarray:
    """Those of `near_photons` that are about `reach` from photons (N, 3) of which several are `apart` or less."""
    cell, number = np.unique(group_key(*cell_index(position, apart)), return_inverse=True, return_counts=True)[1:]
    return _beside(parts, position[number[cell] > 1], reach)


def surface_elements(corners: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles (K, 3), unit normals (K, 3) and areas (K,) of parts of triangles (M, 3, 3), no longer than `longest`.

    Longer where there were too many.
    """
    total = np.linalg.norm(area_vectors(corners), axis=1).sum()
    parts = _divided(corners, max(longest, (HALVES * total / MOST) ** 0.5))
    vectors = area_vectors(parts)
    area = np.linalg.norm(vectors, axis=1)
    rows = np.flatnonzero(area)
    share = area[rows]
    if len(rows) > MOST:
        sums = area.cumsum(dtype=np.float64)
        rows = np.searchsorted(sums, (np.arange(MOST) + 0.5) / MOST * sums[-1])
        share = np.full(MOST, sums[-1] / MOST, np.float32)
    return parts[rows].mean(axis=1), vectors[rows] / area[rows, None], share


def _divided(corners: np.ndarray, longest: float) -> np.ndarray:
    """Triangles (M, 3, 3) of which halves are taken across the longest edge until none is longer than `longest`."""
    parts = []
    while len(corners):
        length = _edges(corners)
        is_long = length.max(axis=1) > longest
        parts.append(corners[~is_long])
        turn = (length[is_long].argmax(axis=1)[:, None] + np.arange(3)) % 3  # the longest edge first
        a, b, c = np.take_along_axis(corners[is_long], turn[..., None], axis=1).swapaxes(0, 1)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([c, a, middle], 1), np.stack([b, c, middle], 1)])
    return np.concatenate(parts) if parts else corners


def _edges(corners: np.ndarray) -> np.ndarray:
    """(M, 3) lengths, from each corner to the next."""
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def _beside(corners: np.ndarray, position: np.ndarray, size: float) -> np.ndarray:
    """Those of triangles (M, 3, 3) whose middles are in cells of a size that hold photons (N, 3), or next to one."""
    cell, steps = np.stack(cell_index(position, size)), np.indices((3, 3, 3)).reshape(3, 1, -1) - 1
    first = np.unique(group_key(*cell), return_index=True)[1]
    lit = (cell[:, first, None] + steps).reshape(3, -1)
    return corners[np.isin(group_key(*cell_index(corners.mean(axis=1), size)), group_key(*lit))]
