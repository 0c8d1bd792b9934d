# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays towards the few surfaces that are much brighter than the others, which rays all around find by chance only.

Both kinds of rays together are weighted by the balance heuristic (Veach and Guibas 1995).
"""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..edge_stopping import dot
from ..sampling import R2, triangle_weights

FAR = 1e6     # network units: no surface is farther off
BRIGHT = 2.0  # times the mean of what is seen: what shines more is aimed at


class Beacons:
    """Triangles (T, 3, 3) of patches, aimed at by the worth of these."""

    def __init__(self, corners: Tensor, patch: Tensor, worth: Tensor):
        """patch: (T,) rows of their patches; worth: (sides,) of their fronts, then of their backs."""
        self.origin, self.edges = corners[:, 0], (corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        vector = torch.linalg.cross(*self.edges) / 2
        area = vector.norm(dim=-1)
        worth = worth.unflatten(0, (2, -1)).sum(0)  # a ray that is aimed at one side of a patch may meet the other
        extent = torch.zeros_like(worth).index_add_(0, patch, area)
        density = (worth / extent.clamp_min(1e-20))[patch]
        filled = (density * area).cpu().double().cumsum(0)  # GPUs may know no float64
        self.lit = bool(len(filled) and filled[-1] > 0)
        if self.lit:
            self.filled = (filled / filled[-1]).float().to(corners.device)
            density /= float(filled[-1])  # of being aimed at, by area
        # The row behind all is for rays that meet nothing, whose triangle is -1, or no patch.
        self.normal, self.density = F.pad(F.normalize(vector, dim=-1), (0, 0, 0, 1)), F.pad(density, (0, 1))

    def aimed(self, position: Tensor, count: int, start: Tensor) -> tuple[Tensor, Tensor]:
        """(P, count, 3) unit vectors from points (P, 3), and (P, count) rows of the triangles that they aim at."""
        k = torch.arange(count, device=position.device)
        share = (k + start[:, :1]) / count
        triangle = torch.searchsorted(self.filled, share, right=True).clamp(max=len(self.filled) - 1)
        u, v = ((k * step + start[:, 1:]) % 1 for step in R2)
        _, u, v = triangle_weights(u, v)[..., None].unbind(-2)
        target = self.origin[triangle] + u * self.edges[0][triangle] + v * self.edges[1][triangle]
        return F.normalize(target - position[:, None], dim=-1), triangle

    def per_angle(self, triangle: Tensor, direction: Tensor, distance: Tensor) -> Tensor:
        """(N,) density by solid angle with which what rays (N, 3) met is aimed at; 0 of what is no patch."""
        nothing = len(self.origin)
        triangle = torch.where(triangle < 0, nothing, triangle.clamp(max=nothing))
        cosine = dot(self.normal.index_select(0, triangle).T, direction.T).abs().clamp_min(1e-6)
        return self.density.index_select(0, triangle) * distance.clamp(max=FAR).square() / cosine


def worth_by_power(leaving: Tensor, size: Tensor) -> Tensor:
    """(sides,) of patches of a `size` (sides,), by how much more than the mean of all leaves them, (sides, 3)."""
    radiance = leaving.mean(-1)
    mean = (size * radiance).sum() / size.sum().clamp_min(1e-20)
    return size * (radiance - BRIGHT * mean).clamp_min(0)


def worth_by_sight(leaving: Tensor, size: Tensor, side: Tensor, share: Tensor) -> Tensor:
    """The same by how much of it arrives at the patches, of which each sees a `share` of some sides (sides, R)."""
    radiance = F.pad(leaving.mean(-1), (0, 1))
    seen = radiance[side]
    arriving = size[:, None] * share
    mean = (arriving * seen).sum() / (size.sum() * seen.shape[1]).clamp_min(1e-20)
    excess = (arriving * (seen - BRIGHT * mean).clamp_min(0)).flatten()
    return torch.zeros_like(radiance).index_add_(0, side.flatten(), excess)[:-1]
