# SPDX-License-Identifier: GPL-3.0-or-later
"""Sums over the squares around pixels."""
from __future__ import annotations

import numpy as np


def box_sums(x: np.ndarray, radius: int) -> np.ndarray:
    """Sums over the 2 radius + 1 pixels squared around each pixel of (H, W, ...); nothing lies outside."""
    for axis in (0, 1):
        margins, size = [(radius, radius) if i == axis else (0, 0) for i in range(x.ndim)], x.shape[axis]
        padded = np.pad(x, margins)
        x = sum(padded[(*[slice(None)] * axis, slice(i, i + size))] for i in range(2 * radius + 1))
    return x


def box_means(x: np.ndarray, radius: int) -> np.ndarray:
    """Means over the pixels of these squares that there are."""
    return box_sums(x, radius) / box_sums(np.ones((*x.shape[:2], *[1] * (x.ndim - 2)), x.dtype), radius)
