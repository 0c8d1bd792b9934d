# SPDX-License-Identifier: GPL-3.0-or-later
"""Group the small triangles of fine meshes, so that there are thousands of patches instead of millions."""
from __future__ import annotations

import math

import numpy as np

from ...clusters import cell_index, facing_side, group_key, groups_of
from ...geometry import area_vectors

MANY = 1 << 16   # triangles up to which each is an element
FINEST = 0.004   # side of a cell whose triangles are one patch, where a unit of area gets all patches
COARSER = 2 ** 0.125  # growth of the cells in each step, of which there are whole ones: they stay while things move
CRUMBS = 0.5     # groups that a surface must have by itself to share none with others, in the finest cells
FEWER = 0.3      # power of how many too many groups there are, with which cells grow at once
SHARED = 4       # power of the size of cells, with which that number grows


def group_elements(corners: np.ndarray, token: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The element (T,) of each of the triangles (T, 3, 3), and the largest triangle (E,) of each element.

    Together are triangles in the same cell that face alike and have the same token (T,). density: (N,) by token, the
    share of all patches that a unit of area gets: cells are the larger, the smaller it is.
    """
    if len(corners) <= MANY:
        return (np.arange(len(corners)),) * 2
    vector = area_vectors(corners)
    cell = FINEST * 2 ** (_level(density) / 2)
    key = group_key(token, facing_side(vector), *cell_index(corners.mean(axis=1), cell[token]))
    return groups_of(key, np.linalg.norm(vector, axis=1))


def group_patches(center: np.ndarray, vector: np.ndarray, kind: np.ndarray, openness: np.ndarray, surface: np.ndarray,
                  density: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """The group (E,) of each element, and how many groups there are: `most` or fewer, of the finest cells.

    Elements with centres and area vectors (E, 3) are together in cells, by density (E,) as above, if they face alike
    and are of the same kind (E,). What stands on a thin floor is no group with its underside, and walls are in no
    group with both sides: different surfaces (E,), or parts of one with different openness (E,), are together only if
    the surfaces are crumbs. An element's group depends only on its own surface, position and side: light does not
    flicker when another moves.
    """
    level, facing = _level(density), facing_side(vector)
    step = 0
    while True:
        growth = COARSER ** step
        cell, crumbs = FINEST * growth, CRUMBS * growth ** SHARED
        shared = group_key(kind, facing, level, *cell_index(center, cell * 2 ** (level / 2)))
        own = group_key(shared, openness, surface)
        first = np.unique(own, return_index=True)[1]
        is_crumb = np.bincount(surface[first])[surface] < crumbs
        groups, group = np.unique(np.where(is_crumb, shared, own), return_inverse=True)
        if len(groups) <= most:
            return group.reshape(-1), len(groups)
        step += max(int(FEWER * math.log(len(groups) / most, COARSER)), 1)


def _level(density: np.ndarray) -> np.ndarray:
    return -np.log2(density).round()
