# SPDX-License-Identifier: GPL-3.0-or-later
"""Needles: long, narrow triangles that are cut across, because quarters of them would be as long and narrow."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ...geometry import area_vectors

NARROW = 4.0  # times that a needle is longer than its shortest side at least
MOST = 64     # slices of one
BY_WIDTH = 0.3  # how far the narrowest count for less, such as edges of boards, which would take the others' patches
PIECES = 2    # triangles of a slice, at most
ROUNDS = 40


@dataclass
class Slices:
    """Parts of G triangles, which are their own only part where they are not cut. Parts of others follow behind."""

    first: Tensor    # (G + 1,) i64, first part; the last one is of no triangle
    count: Tensor    # (G + 1,) i64, slices; 1 = not cut
    sharp: Tensor    # (G + 1,) i64, corner that the slices end at
    inverse: Tensor  # (K, 3, 3) f32, from weights of a triangle's corners to those of its part's, of parts from G on

    def to(self, device: torch.device) -> Slices:
        return Slices(*(x.to(device) for x in vars(self).values()))

    def find(self, triangle: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
        """Parts (P,) at weights (P, 2) of corners 0 and 1 of triangles (P,), -1 for -1, and the weights in them."""
        cut = (self.count[triangle] > 1).nonzero()[:, 0]
        if not len(cut):
            return triangle, weights
        part, weights, whole = triangle.to(torch.int64, copy=True), weights.clone(), triangle[cut]
        of_triangle = torch.cat([weights[cut], 1 - weights[cut].sum(1, keepdim=True)], 1)
        along = of_triangle.gather(1, self.sharp[whole, None])[:, 0]
        slice_ = torch.minimum((along.clamp(0, 1) * self.count[whole]).long(), self.count[whole] - 1)
        lower = self.first[whole] + PIECES * slice_
        is_upper = ((self._within(lower, of_triangle) < 0).any(1)) & (slice_ < self.count[whole] - 1)
        part[cut] = lower + is_upper
        weights[cut] = self._within(part[cut], of_triangle)[:, :2]
        return part, weights

    def _within(self, part: Tensor, weights: Tensor) -> Tensor:
        """(P, 3) weights in parts from G on, of those in their triangles."""
        return (self.inverse[part - len(self.first) + 1] @ weights[..., None])[..., 0]


def sharp_corners(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (N,) opposite of the shortest sides of triangles (N, 3, 3), and how many times longer the longest is."""
    opposite = np.linalg.norm(np.roll(triangles, -1, axis=1) - np.roll(triangles, -2, axis=1), axis=-1)
    sharp = opposite.argmin(axis=1)
    return sharp, opposite.max(axis=1) / opposite.min(axis=1).clip(1e-12)


def slice_counts(triangles: np.ndarray, size: np.ndarray, density: np.ndarray, target: int) -> np.ndarray:
    """(N,) slices of triangles (N, 3, 3), 1 for what is no needle, so that pieces are about equally long.

    Narrow ones are longer. size: (N,), share of all `target` pieces by area; density: (N,), share of a unit of area.
    """
    _, ratio = sharp_corners(triangles)
    length2 = np.square(triangles - np.roll(triangles, 1, axis=1)).sum(axis=-1).max(axis=1)
    wide = 2 * np.linalg.norm(area_vectors(triangles), axis=1) / length2.clip(1e-30)  # over their length
    is_needle, by_length = ratio > NARROW, length2 * density * wide.clip(1e-6, 1) ** BY_WIDTH
    low, high = 1e-12 * max(by_length.max(initial=0), 1e-12), max(by_length.max(initial=0), 1e-12) * len(size)
    for _ in range(ROUNDS):  # of the squared length of a piece, in shares
        middle = np.sqrt(low * high)
        pieces = np.where(is_needle, PIECES * np.sqrt(by_length / middle), size / middle).sum()
        low, high = (middle, high) if pieces > target else (low, middle)
    count = np.minimum(np.sqrt(by_length / high), 1 / wide.clip(1e-6)).round().clip(1, MOST)
    return np.where(is_needle, count, 1).astype(np.int64)


def weights_of_parts(sharp: int, count: int) -> np.ndarray:
    """(PIECES count - 1, 3, 3) f32 weights of a triangle's corners at the corners of its parts, from its short side."""
    none, lines = np.zeros(count), [(np.arange(count) + end) / count for end in (0, 1)]  # across, by the sharp corner
    (left, upper_left), (right, upper_right) = (
        [np.stack([at, *((1 - at, none) if is_left else (none, 1 - at))], axis=1) for at in lines]
        for is_left in (True, False))
    lower, upper = (np.stack(corners, axis=1) for corners in ((upper_left, left, right),
                                                              (upper_left, right, upper_right)))
    return np.roll(np.stack([lower, upper], axis=1).reshape(-1, 3, 3)[:-1], sharp, axis=2).astype(np.float32)
