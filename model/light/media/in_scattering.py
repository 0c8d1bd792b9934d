# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of emitters and sky that media scatter once to the camera and to surfaces, as Cycles does by default."""
from __future__ import annotations

import copy
from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional as F

from ..sampling import hashed_starts
from .transmittance import SIDE, Fog

STEPS = 24   # along a ray through the media
POINTS = 6   # of a cell, at which emitters light it

RadianceInAir = Callable[[Tensor], Tensor]  # of points (P, 3): (P, 3), the mean over all directions


class InScattering:
    """What the cells of a fog send in all directions, computed once for all views."""

    def __init__(self, fog: Fog, sky: RadianceInAir, emitters: RadianceInAir):
        cells = fog.scattering.amax(1).nonzero()[:, 0]
        light = torch.zeros_like(fog.scattering)
        middle = fog.points_in(cells, torch.full((len(cells), 3), 0.5, device=cells.device))
        light[cells] = sky(fog.points_in(cells, hashed_starts(middle, 3)))
        for k in range(POINTS):
            light[cells] += emitters(fog.points_in(cells, hashed_starts(middle + k, 3))) / POINTS
        cells = torch.cat([light * fog.scattering, fog.extinction], dim=1)
        self.fog = fog
        self.cells = cells.T.reshape(1, -1, SIDE, SIDE, SIDE)  # RGB per unit of length, extinction

    def fire(self) -> InScattering | None:
        """What the cells send out by themselves instead; None if that is nothing."""
        if self.fog.emission is None:
            return None
        fire = copy.copy(self)
        emission = self.fog.emission.T.reshape(1, 3, SIDE, SIDE, SIDE)
        fire.cells = torch.cat([emission, self.cells[:, 3:]], dim=1)
        return fire

    def __call__(self, origin: Tensor, end: Tensor, steps: int = STEPS) -> Tensor:
        """(P, 3) radiance that arrives at points (P, 3) from the media before the points `end` (P, 3)."""
        ray = end - origin
        enters, leaves = self.fog.crossed(origin, ray)
        step = (leaves - enters) * ray / steps
        length = step.norm(dim=1, keepdim=True)
        radiance, transmittance = torch.zeros_like(origin), torch.ones_like(length)
        for k in range(steps):
            light, extinction = self._at(origin + enters * ray + (k + 0.5) * step).tensor_split([3], dim=1)
            absorbed = extinction * length
            mean = torch.where(absorbed > 1e-4, -torch.expm1(-absorbed) / absorbed.clamp_min(1e-4), 1 - absorbed / 2)
            radiance += transmittance * light * length * mean
            transmittance = transmittance * (-absorbed).exp()
        return radiance

    def _at(self, x: Tensor) -> Tensor:
        """(P, 3 + C) interpolated between the cells."""
        position = (2 * (x - self.fog.low) / (SIDE * self.fog.cell) - 1).flip(-1)
        return F.grid_sample(self.cells, position.view(1, -1, 1, 1, 3), align_corners=False,
                             padding_mode="border")[0, :, :, 0, 0].T
