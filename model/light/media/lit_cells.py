# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that the cells of media send to surfaces."""
from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional as F

from ..sampling import hashed_starts
from .ray_march import march
from .transmittance import SIDE, Fog

STEPS = 8     # along a ray
CELLS = 8     # that each point looks at
BRIGHT = 2.0  # times the mean of all cells, from which on it does
NEAREST = 1e-4  # network units

IsBlocked = Callable[[Tensor, Tensor, Tensor], Tensor]  # as of TensorRays


class LitCells:
    """The cells of a fog, and what each sends in all directions."""

    def __init__(self, fog: Fog, sent: Tensor):
        """sent: (SIDE^3, 3) radiance per unit of length."""
        self._fog, self._sent = fog, sent
        power = sent.mean(1)
        excess = (power - BRIGHT * power.mean()).clamp_min(0)
        self._share = excess / power.clamp_min(1e-20)  # of what cells send that points look for
        self._until = excess.cumsum(0)
        self._density = excess / (self._until[-1] * fog.cell.prod()).clamp_min(1e-20)  # of the places they look at

    def diffuse(self, position: Tensor, normal: Tensor, end: Tensor, start: Tensor, is_blocked: IsBlocked) -> Tensor:
        """(P, 3) radiance that white diffuse surfaces at points (P, 3) with unit normals (P, 3) send on.

        By rays to the points `end` (P, R, 3), as dense as the cosine, which would miss bright places such as beams. So
        some more go to cells, by how much brighter these are than most; the balance heuristic (Veach and Guibas 1995)
        weights what both find of that. start: (P, 2), which spreads the latter.
        """
        rays = end.shape[1]
        origin = position[:, None].expand_as(end).flatten(0, 1)
        end = end.flatten(0, 1)
        cosine = _cosine(end - origin, normal.repeat_interleave(rays, 0))

        def sent_at(x: Tensor, distance: Tensor) -> tuple[Tensor, Tensor]:
            cell = self._fog.cells_at(x)
            return (1 - self._weight(cell, distance, cosine, rays)) * self._sent[cell], self._fog.extinction[cell]

        radiance = march(self._fog, sent_at, origin, end, STEPS).radiance.view(-1, rays, 3).mean(1)
        if not self._until[-1] > 0:
            return radiance
        k = torch.arange(CELLS, device=start.device)
        cell = torch.searchsorted(self._until, (k + start[:, :1]) / CELLS * self._until[-1], right=True)
        cell = cell.clamp(max=len(self._until) - 1).flatten()
        origin, normal = (x.repeat_interleave(CELLS, 0) for x in (position, normal))
        x = self._fog.points_in(cell, hashed_starts(origin + k.repeat(len(position))[:, None], 3))
        distance = (x - origin).norm(dim=1, keepdim=True).clamp_min(NEAREST)
        cosine = _cosine(x - origin, normal)
        weight = self._weight(cell, distance, cosine, rays) * cosine / (
            math.pi * distance.square() * self._density[cell, None].clamp_min(1e-20))
        facing = (weight[:, 0] > 0).nonzero()[:, 0]
        weight[facing] *= 1.0 * ~is_blocked(
            origin[facing], ((x - origin) / distance)[facing], distance[facing, 0])[:, None]
        found = weight * self._sent[cell] * self._fog.transmittance(origin, x)
        return radiance + found.view(-1, CELLS, 3).mean(1)

    def _weight(self, cell: Tensor, distance: Tensor, cosine: Tensor, rays: int) -> Tensor:
        """(P, 1) of what rays to cells (P,) find at distances (P, 1), beside so many others."""
        to_cells = CELLS * self._density[cell, None]
        # The others find what is anywhere on their way through the grid.
        others = rays * cosine / (math.pi * distance.clamp_min(NEAREST).square() * self._fog.cell.norm() * SIDE / 2)
        return self._share[cell, None] * to_cells / (to_cells + others).clamp_min(1e-20)


def _cosine(ray: Tensor, normal: Tensor) -> Tensor:
    return (F.normalize(ray, dim=1) * normal).sum(1, keepdim=True).clamp_min(0)
