# SPDX-License-Identifier: GPL-3.0-or-later
"""Cluster weighted points by splitting the group with the largest variance (Wan, Wong and Prusinkiewicz 1988)."""
from __future__ import annotations

import numpy as np

NEGLIGIBLE = 1e-12  # share of the total variance below which a group is not split


def split_clusters(points: np.ndarray, weights: np.ndarray, groups: list[np.ndarray], most: int) -> list[np.ndarray]:
    """`groups` (rows of the (N, K) points) split until there are `most`, or none has any variance.

    weights: (N,) >= 0; a group is split at its weighted mean of the coordinate with the largest variance.
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
