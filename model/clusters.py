# SPDX-License-Identifier: GPL-3.0-or-later
"""Group points: by splitting the group with the largest variance, or by cells of a grid and the side that they face."""
from __future__ import annotations

import numpy as np

NEGLIGIBLE = 1e-12  # share of the total variance below which a group is not split


def split_clusters(points: np.ndarray, weights: np.ndarray, groups: list[np.ndarray], most: int) -> list[np.ndarray]:
    """`groups` (rows of the (N, K) points) split until there are `most`, or none has any variance.

    weights: (N,) >= 0; a group is split at its weighted mean of the coordinate with the largest variance (Wan, Wong and
    Prusinkiewicz 1988).
    """
    groups = list(groups)
    spread = [_variance(points[rows], weights[rows]) for rows in groups]
    least = NEGLIGIBLE * sum(variance.sum() for variance in spread)
    while groups and len(groups) < most:
        widest = int(np.argmax([variance.sum() for variance in spread]))
        rows, variance = groups[widest], spread[widest]
        if variance.sum() <= least:
            break
        along = points[rows, variance.argmax()]
        above = along > np.average(along, weights=weights[rows])
        if above.all() or not above.any():  # equal points, which rounding puts on one side of their own mean
            spread[widest] = np.zeros_like(variance)
            continue
        halves = rows[above], rows[~above]
        groups[widest:widest + 1] = halves
        spread[widest:widest + 1] = [_variance(points[half], weights[half]) for half in halves]
    return groups


def _variance(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(K,) sum of weight times squared distance from the weighted mean."""
    total = weights.sum()
    if total <= 0:
        return np.zeros(points.shape[1])
    mean = weights @ points / total
    return weights @ np.square(points - mean)


def facing_side(vector: np.ndarray) -> np.ndarray:
    """(S,) which of six sides, by axis and sign, vectors (S, 3) point to."""
    axis = np.abs(vector).argmax(axis=1)
    return 2 * axis + (vector[np.arange(len(vector)), axis] < 0)


def cell_index(position: np.ndarray, side: np.ndarray | float) -> np.ndarray:
    """(3, S) f, cells of side (S,) in which positions (S, 3) are."""
    return np.floor(position / np.reshape(side, (-1, 1))).T


def group_key(*columns: np.ndarray) -> np.ndarray:
    """(S,) u64 hash of columns (S,) of whole numbers; different rows are as good as never equal."""
    key = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        whole = column if column.dtype == np.uint64 else column.astype(np.int64).view(np.uint64)
        key = (key + whole) * np.uint64(0x9E3779B97F4A7C15)  # Steele et al. 2014
        key = (key ^ key >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
        key ^= key >> np.uint64(27)
    return key


def groups_of(key: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(S,) groups of equal keys (S,), and (E,) rows of their largest members by size (S,), the first of equal ones."""
    if not len(key):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    order = np.argsort(key, kind="stable")
    begins = np.insert(np.diff(key[order]) != 0, 0, True)
    sorted_group, size = np.cumsum(begins) - 1, size[order]
    largest = np.flatnonzero(size == np.maximum.reduceat(size, np.flatnonzero(begins))[sorted_group])
    first = np.insert(np.diff(sorted_group[largest]) != 0, 0, True)
    group = np.empty(len(key), np.int64)
    group[order] = sorted_group
    return group, order[largest[first]]
