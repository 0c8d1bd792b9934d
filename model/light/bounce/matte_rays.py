# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays from matte points: by the cosine, guided to where light arrives from, and aimed at bright patches.

All together are weighted by the balance heuristic (Veach and Guibas 1995).
"""
from __future__ import annotations

import math

import torch
from torch import Tensor

from ..direct.environment_light import LIFT
from ..sampling import cosine_directions
from .bright_patches import BrightPatches
from .guide import Guide

GUIDED = 0.6  # share of the rays that are not aimed, where there is a guide


class MatteRays:
    """From each of P points along unit vectors `direction` (P, R + A, 3), the last A of which are aimed.

    The first `plain` of the others have a density of the cosine.
    """

    def __init__(self, position: Tensor, normal: Tensor, start: Tensor, rays: int, aimed: int,
                 bright: BrightPatches | None, guide: Guide | None):
        """At points (P, 3) with unit normals (P, 3); start: (P, 2) in [0, 1), which spreads the rays."""
        self.unaimed, self.start, self._normal, self._bright = rays, start, normal, bright
        guided = round(GUIDED * rays) if guide is not None else 0
        self.plain, self._rows, self._target = rays - guided, None, None
        directions = [cosine_directions(normal, self.plain, start)]
        if guided:
            self._guide, self._rows, start = guide, guide.rows(position, normal), (start + 0.5) % 1
            self._has_none = (self._rows == guide.none)[:, None]
            directions.append(guide.sample(self._rows, guided, start))
            others = self._has_none.nonzero()[:, 0]
            directions[1][others] = cosine_directions(normal[others], guided, start[others])
        if aimed and bright is not None and bright.exist:
            aimed_direction, self._target = bright.sample(position + LIFT * normal, aimed, self.start)
            directions.append(aimed_direction)
        self.direction = torch.cat(directions, 1)

    def weights(self, triangle: Tensor, distance: Tensor) -> tuple[Tensor, Tensor]:
        """(P, R + A), with which the mean over all rays is that over rays with a density of the cosine.

        And (P, R), with which that over the rays that are not aimed is the same. triangle, distance: (P (R + A),) what
        they hit, as of BrightPatches.density_by_angle.
        """
        count, rays = self.direction.shape[1], self.unaimed
        cosine = (self.direction @ self._normal[..., None])[..., 0].clamp_min(0) / math.pi
        density = self.plain * cosine
        if self._rows is not None:
            by_guide = self._guide.density(self._rows, self.direction)
            density = density + (rays - self.plain) * torch.where(self._has_none, cosine, by_guide)
        unaimed = (rays * cosine / density.clamp_min(1e-9))[:, :rays]
        if self._target is None:
            return unaimed, unaimed
        by_aim = self._bright.density_by_angle(triangle, self.direction.flatten(0, 1), distance)
        weight = count * cosine / (density + (count - rays) * by_aim.view_as(cosine)).clamp_min(1e-9)
        weight[:, rays:] *= triangle.view_as(weight)[:, rays:] == self._target
        return weight, unaimed
