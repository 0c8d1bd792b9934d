# SPDX-License-Identifier: GPL-3.0-or-later
"""Where light arrives from, all over a scene, so that gather rays can be guided there.

Histograms over directions in cells of space, filled by the rays by which patches have exchanged light (after Jensen
1995, "Importance driven path tracing using the photon map", and Müller et al. 2017, "Practical path guiding").
"""
from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional as F

from ..sampling import GOLDEN

ROWS, COLUMNS = 12, 24   # bins of equal solid angle: by height, and around
BINS = ROWS * COLUMNS
SIZES = 0.06, 0.12, 0.25, 0.5, 1.0  # network units, of cells
ENOUGH = 384             # rays into a cell, from which on it has a histogram
SPREAD = 0.25, 0.5, 0.25  # of light, over the bins around
HALF = 1 << 16           # cells along an axis, on either side of 0


class Guide:
    """Filled by R rays from each of S points x (S, 3) with unit normals n (S, 3), along unit vectors (S, R, 3).

    bounced, sky: (S, R) radiance that arrives along them from surfaces and from the sky, times the weights of the rays.
    The sky attracts as many rays as all surfaces at most, or what they send would be noisy in broad daylight.
    """

    def __init__(self, x: Tensor, n: Tensor, direction: Tensor, bounced: Tensor, sky: Tensor):
        bins, histograms = _bins(direction), []
        self._cells = []  # by size: sorted numbers of those that have a histogram, and the row of the first
        for size in SIZES:
            cell, row, points = _cells(x, n, size).unique(return_inverse=True, return_counts=True)
            at = (row[:, None] * BINS + bins).flatten()
            of_surfaces, of_sky = (
                x.new_zeros(len(cell) * BINS).index_add_(0, at, light.clamp_min(0).flatten()).view(-1, BINS)
                for light in (bounced, sky))
            most = of_surfaces.sum(1, keepdim=True) / of_sky.sum(1, keepdim=True).clamp_min(1e-20)
            histogram = of_surfaces + of_sky * most.clamp(max=1)
            chosen = (points * bins.shape[1] >= ENOUGH) & (histogram.sum(1) > 0)
            self._cells.append((cell[chosen], sum(map(len, histograms))))
            histograms.append(_spread(histogram[chosen]))
        share = torch.cat(histograms)
        self.none = len(share)  # the row of points that have no histogram
        self._share = F.pad(share / share.sum(1, keepdim=True), (0, 0, 0, 1))
        self._cumulative = self._share.cumsum(1)

    def rows(self, x: Tensor, n: Tensor) -> Tensor:
        """(P,) of the histograms of the smallest cells that have one, at points as above."""
        rows = torch.full_like(x[:, 0], self.none, dtype=torch.long)
        for (cell, first), size in reversed(list(zip(self._cells, SIZES, strict=True))):
            if len(cell):
                wanted = _cells(x, n, size)
                at = torch.searchsorted(cell, wanted).clamp(max=len(cell) - 1)
                rows = torch.where(cell[at] == wanted, first + at, rows)
        return rows

    def sample(self, rows: Tensor, count: int, start: Tensor) -> Tensor:
        """(P, count, 3) unit vectors by the histograms in `rows` (P,); start: (P, 2) in [0, 1)."""
        k, cumulative = torch.arange(count, device=start.device), self._cumulative[rows]
        threshold = (k + start[:, :1]) / count
        bins = torch.searchsorted(cumulative, threshold, right=True).clamp(max=BINS - 1)
        width = self._share[rows].gather(1, bins)
        across = (1 - (cumulative.gather(1, bins) - threshold) / width.clamp_min(1e-9)).clamp(0, 1)
        z = (bins // COLUMNS + (k * GOLDEN + start[:, 1:]) % 1) / (ROWS / 2) - 1
        phi = (bins % COLUMNS + across) * (2 * math.pi / COLUMNS)
        sine = (1 - z.square()).clamp_min(0).sqrt()
        return torch.stack([sine * phi.cos(), sine * phi.sin(), z], -1)

    def density(self, rows: Tensor, direction: Tensor) -> Tensor:
        """(P, R) by solid angle with which `sample` chooses unit vectors (P, R, 3)."""
        at = rows[:, None] * BINS + _bins(direction)
        return self._share.view(-1).index_select(0, at.flatten()).view_as(at) * (BINS / (4 * math.pi))


def _bins(direction: Tensor) -> Tensor:
    """(...) of unit vectors (..., 3)."""
    row = ((direction[..., 2] + 1) * (ROWS / 2)).long().clamp(0, ROWS - 1)
    around = torch.atan2(direction[..., 1], direction[..., 0]) / (2 * math.pi) % 1
    return row * COLUMNS + (around * COLUMNS).long().clamp(max=COLUMNS - 1)


def _spread(histogram: Tensor) -> Tensor:
    """(H, BINS), each bin with a share of those around."""
    before, same, after = SPREAD
    image = histogram.view(-1, ROWS, COLUMNS)
    image = before * image.roll(1, 2) + same * image + after * image.roll(-1, 2)
    image = torch.cat([image[:, :1], image, image[:, -1:]], 1)
    return (before * image[:, :-2] + same * image[:, 1:-1] + after * image[:, 2:]).flatten(1)


def _cells(x: Tensor, n: Tensor, size: float) -> Tensor:
    """(P,) i64 numbers of the cells of points x (P, 3), others for each main axis of their normals n (P, 3)."""
    i, j, k = ((x / size).floor().clamp(-HALF, HALF - 1).long() + HALF).unbind(-1)
    axis = n.abs().argmax(-1)
    side = 2 * axis + (n.gather(1, axis[:, None])[:, 0] > 0)
    return ((i * 2 * HALF + j) * 2 * HALF + k) * 6 + side
