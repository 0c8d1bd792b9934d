# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance sampling of the few patches that are much brighter than the others, which uniform rays hit by chance only.
"""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..sampling import R2, triangle_weights
from ..vectors import dot, unit

FARTHEST = 1e6  # network units: no surface is farther off
BRIGHT = 2.0    # times the mean radiance, from which on a patch is aimed at


class BrightPatches:
    """Triangles (T, 3, 3), aimed at by the importance of the patches that they belong to."""

    def __init__(self, corners: Tensor, solid: Tensor, patch: Tensor, importance: Tensor):
        """solid: (T,) bool, those that rays hit; patch: (T,) rows of the patches; importance: (sides,) of their fronts,
        then of their backs."""
        importance = importance.unflatten(0, (2, -1)).sum(0)  # a ray aimed at one side may hit the other
        self._triangle = (solid & (importance > 0)[patch]).nonzero()[:, 0]
        # By triangle, with one entry behind all for rays that hit nothing.
        self._row = torch.full((len(corners) + 1,), len(self._triangle), device=corners.device)
        self._row[self._triangle] = torch.arange(len(self._triangle), device=corners.device)
        corners, patch = corners[self._triangle], patch[self._triangle]
        self.origin, self.edges = corners[:, 0], (corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        vector = torch.linalg.cross(*self.edges) / 2
        area = vector.norm(dim=-1)
        patch_area = torch.zeros_like(importance).index_add_(0, patch, area)
        density = (importance / patch_area.clamp_min(1e-20))[patch]
        cumulative = (density * area).cpu().double().cumsum(0)  # GPUs may know no float64
        self.exist = bool(len(cumulative) and cumulative[-1] > 0)
        if self.exist:
            self.cumulative = (cumulative / cumulative[-1]).float().to(corners.device)
            density /= float(cumulative[-1])  # by area
        # The row behind all is for rays that hit none of them.
        self.normal, self.density = F.pad(F.normalize(vector, dim=-1), (0, 0, 0, 1)), F.pad(density, (0, 1))

    def sample(self, position: Tensor, count: int, start: Tensor) -> tuple[Tensor, Tensor]:
        """(P, count, 3) unit vectors from points (P, 3), and (P, count) rows of the triangles that they aim at."""
        k = torch.arange(count, device=position.device)
        threshold = (k + start[:, :1]) / count
        triangle = torch.searchsorted(self.cumulative, threshold, right=True).clamp(max=len(self.cumulative) - 1)
        u, v = ((k * step + start[:, 1:]) % 1 for step in R2)
        _, u, v = triangle_weights(u, v)[..., None].unbind(-2)
        target = self.origin[triangle] + u * self.edges[0][triangle] + v * self.edges[1][triangle]
        return unit(target - position[:, None]), self._triangle[triangle]

    def density_by_angle(self, triangle: Tensor, direction: Tensor, distance: Tensor) -> Tensor:
        """(N,) density by solid angle with which `sample` aims along rays (N, 3) that hit triangles (N,).

        One behind all is for rays that hit none.
        """
        row = self._row[triangle]
        cosine = dot(self.normal.index_select(0, row), direction).abs().clamp_min(1e-6)
        return self.density.index_select(0, row) * distance.clamp(max=FARTHEST).square() / cosine


def importance_by_power(leaving: Tensor, size: Tensor) -> Tensor:
    """(sides,) how much more power than BRIGHT times the mean leaves patches of a `size` (sides,).

    leaving: (sides, 3) radiance.
    """
    radiance = leaving.mean(-1)
    mean = (size * radiance).sum() / size.sum().clamp_min(1e-20)
    return size * (radiance - BRIGHT * mean).clamp_min(0)


def importance_by_arrival(leaving: Tensor, size: Tensor, side: Tensor, share: Tensor) -> Tensor:
    """The same by how much of it arrives at the patches, whose rays hit sides (sides, R) with a `share` (sides, R)."""
    radiance = F.pad(leaving.mean(-1), (0, 1))
    hit_radiance = radiance[side]
    weight = size[:, None] * share
    mean = (weight * hit_radiance).sum() / (size.sum() * hit_radiance.shape[1]).clamp_min(1e-20)
    excess = (weight * (hit_radiance - BRIGHT * mean).clamp_min(0)).flatten()
    return torch.zeros_like(radiance).index_add_(0, side.flatten(), excess)[:-1]
