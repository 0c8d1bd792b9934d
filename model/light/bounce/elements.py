# SPDX-License-Identifier: GPL-3.0-or-later
"""Group the crumbs of fine meshes, so that what follows works on thousands of elements instead of millions."""
from __future__ import annotations

import numpy as np

from ...geometry import area_vectors

MANY = 1 << 15   # triangles up to which each is an element
FINEST = 0.008   # side of a cell whose triangles are one element, where a unit of area gets all patches


def group_crumbs(corners: np.ndarray, token: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The element (T,) of each of the triangles (T, 3, 3), and the largest triangle (E,) of each element.

    Together are triangles in the same cell that face alike and have the same token (T,). density: (N,) by token, the
    share of all patches that a unit of area gets: cells are the larger, the smaller it is.
    """
    if len(corners) <= MANY:
        return (np.arange(len(corners)),) * 2
    vector = area_vectors(corners)
    axis = np.abs(vector).argmax(axis=1)
    facing = 2 * axis + (np.take_along_axis(vector, axis[:, None], axis=1)[:, 0] < 0)
    cell = FINEST * 2 ** (-np.log2(density).round() / 2)
    key = np.zeros(len(corners), np.uint64)
    for part in (token, facing, *np.floor(corners.mean(axis=1) / cell[token, None]).astype(np.int64).T):
        key = (key ^ part.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)  # Knuth's multiplicative hashing
        key ^= key >> np.uint64(29)
    area = np.linalg.norm(vector, axis=1)
    order = np.lexsort((-area, key))
    begins = np.insert(np.diff(key[order]) != 0, 0, True)
    element = np.empty(len(corners), np.int64)
    element[order] = np.cumsum(begins) - 1
    return element, order[begins]
