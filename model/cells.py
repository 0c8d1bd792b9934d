# SPDX-License-Identifier: GPL-3.0-or-later
"""Group triangles by the cells of a grid that they are in and the way that they face."""
from __future__ import annotations

import numpy as np


def facing_side(vector: np.ndarray) -> np.ndarray:
    """(S,) which of six sides vectors (S, 3) point to."""
    axis = np.abs(vector).argmax(axis=1)
    return 2 * axis + (vector[np.arange(len(vector)), axis] < 0)


def cell_index(position: np.ndarray, side: np.ndarray | float) -> np.ndarray:
    """(3, S) the cell that positions (S, 3) are in, of cells with sides (S,)."""
    return np.floor(position / np.reshape(side, (-1, 1))).T


def group_key(*columns: np.ndarray) -> np.ndarray:
    """(S,) u64, alike where all columns (S,) of whole numbers are, and nowhere else by any likely chance."""
    key = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        whole = column if column.dtype == np.uint64 else column.astype(np.int64).view(np.uint64)
        key = (key + whole) * np.uint64(0x9E3779B97F4A7C15)  # Steele et al. 2014
        key = (key ^ key >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
        key ^= key >> np.uint64(27)
    return key


def groups_of(key: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The group (S,) of each of S things with keys (S,), and the largest (E,) of each group by size (S,), the first of
    several as large."""
    order = np.lexsort((-size, key))
    begins = np.insert(np.diff(key[order]) != 0, 0, True) if len(order) else np.zeros(0, bool)
    group = np.empty(len(key), np.int64)
    group[order] = np.cumsum(begins) - 1
    return group, order[begins]
