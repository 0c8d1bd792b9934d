# SPDX-License-Identifier: GPL-3.0-or-later
"""Group the small triangles of fine meshes, so that there are thousands of patches instead of millions."""
from __future__ import annotations

import numpy as np

from ...geometry import area_vectors

MANY = 1 << 15   # triangles up to which each is an element
FINEST = 0.008   # side of a cell whose triangles are one patch, where a unit of area gets all patches
COARSER = 2 ** 0.25  # growth of the cells while there are too many
CRUMBS = 8       # groups that a surface must have by itself to share none with others, in the finest cells
SHARED = 2       # growth of that number


def group_elements(corners: np.ndarray, token: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The element (T,) of each of the triangles (T, 3, 3), and the largest triangle (E,) of each element.

    Together are triangles in the same cell that face alike and have the same token (T,). density: (N,) by token, the
    share of all patches that a unit of area gets: cells are the larger, the smaller it is.
    """
    if len(corners) <= MANY:
        return (np.arange(len(corners)),) * 2
    vector = area_vectors(corners)
    cell = FINEST * 2 ** (_level(density) / 2)
    key = _key(token, _facing(vector), *_cells(corners.mean(axis=1), cell[token]))
    order = np.lexsort((-np.linalg.norm(vector, axis=1), key))
    begins = np.insert(np.diff(key[order]) != 0, 0, True)
    element = np.empty(len(corners), np.int64)
    element[order] = np.cumsum(begins) - 1
    return element, order[begins]


def group_patches(center: np.ndarray, vector: np.ndarray, glass: np.ndarray, openness: np.ndarray, surface: np.ndarray,
                  density: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """The group (E,) of each element, and how many groups there are: `most` or fewer, of the finest cells.

    Elements with centres and area vectors (E, 3) are together in cells, by density (E,) as above, if they face alike
    and all or none are glass (E,). What stands on a thin floor is no group with its underside, and walls are in no
    group with both sides: different surfaces (E,), or parts of one with different openness (E,), are together only if
    the surfaces are crumbs. An element's group depends only on its own surface, position and side: light does not
    flicker when another moves.
    """
    level, facing = _level(density), _facing(vector)
    cell, crumbs = FINEST, float(CRUMBS)
    while True:
        shared = _key(glass, facing, level, *_cells(center, cell * 2 ** (level / 2)))
        own = _key(shared, openness, surface)
        first = np.unique(own, return_index=True)[1]
        is_crumb = np.bincount(surface[first])[surface] < crumbs
        groups, group = np.unique(np.where(is_crumb, shared, own), return_inverse=True)
        if len(groups) <= most:
            return group.reshape(-1), len(groups)
        cell, crumbs = cell * COARSER, crumbs * SHARED


def _level(density: np.ndarray) -> np.ndarray:
    return -np.log2(density).round()


def _facing(vector: np.ndarray) -> np.ndarray:
    """(S,) which of six sides vectors (S, 3) point to."""
    axis = np.abs(vector).argmax(axis=1)
    return 2 * axis + (vector[np.arange(len(vector)), axis] < 0)


def _cells(position: np.ndarray, side: np.ndarray) -> np.ndarray:
    """(3, S) the cell that positions (S, 3) are in, of cells with sides (S,)."""
    return np.floor(position / side[:, None]).T


def _key(*columns: np.ndarray) -> np.ndarray:
    """(S,) u64, alike where all columns (S,) of whole numbers are, and nowhere else by any likely chance."""
    key = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        whole = column if column.dtype == np.uint64 else column.astype(np.int64).view(np.uint64)
        key = (key + whole) * np.uint64(0x9E3779B97F4A7C15)
        key = (key ^ key >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
        key ^= key >> np.uint64(27)
    return key
