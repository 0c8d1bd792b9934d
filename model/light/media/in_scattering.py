# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of lamps and sky that volumes scatter to the camera and to surfaces, once, as Cycles does by default."""
from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional as F

from ..sampling import scattered
from .transmittance import SIDE

if TYPE_CHECKING:
    from ..direct.direct_light import LightPrior

STEPS = 24   # along a ray through the volumes
PLACES = 6   # of a cell, at which lamps light it


class InScattering:
    """What the cells of a LightPrior's fog send in all directions, found once for all views; `prior.fog` is there."""

    def __init__(self, prior: LightPrior):
        fog = prior.fog
        cells = fog.scattering.amax(1).nonzero()[:, 0]
        cells = cells[cells < SIDE ** 3]
        light = torch.zeros_like(fog.scattering)
        middle = fog.places(cells, torch.full((len(cells), 3), 0.5, device=cells.device))
        light[cells] = prior.sky_around(fog.places(cells, scattered(middle, 3)))
        for k in range(PLACES):
            light[cells] += prior.lamps_around(fog.places(cells, scattered(middle + k, 3))) / PLACES
        cells = torch.cat([light * fog.scattering, fog.density[:, None]], dim=1)[:-1]
        self.low, self.extent = fog.low, fog.cell * SIDE
        self.cells = cells.T.reshape(1, 4, SIDE, SIDE, SIDE)  # RGB per unit of length, extinction

    def __call__(self, origin: Tensor, end: Tensor, steps: int = STEPS) -> Tensor:
        """(P, 3) radiance that arrives at points (P, 3) from the volumes before the points `end` (P, 3)."""
        way = end - origin
        near, far = ((side - origin) / torch.where(way.abs() < 1e-9, torch.full_like(way, 1e-9), way)
                     for side in (self.low, self.low + self.extent))
        enters = torch.minimum(near, far).amax(1, keepdim=True).clamp(0, 1)
        leaves = torch.maximum(near, far).amin(1, keepdim=True).clamp(0, 1)
        step = (leaves - enters).clamp_min(0) * way / steps
        length = step.norm(dim=1, keepdim=True)
        found, passing = torch.zeros_like(origin), torch.ones_like(length)
        for k in range(steps):
            light, extinction = self._at(origin + enters * way + (k + 0.5) * step).split([3, 1], dim=1)
            absorbed = extinction * length
            mean = torch.where(absorbed > 1e-4, -torch.expm1(-absorbed) / absorbed.clamp_min(1e-4), 1 - absorbed / 2)
            found += passing * light * length * mean
            passing = passing * (-absorbed).exp()
        return found

    def _at(self, x: Tensor) -> Tensor:
        """(P, 4) between the cells."""
        place = (2 * (x - self.low) / self.extent - 1).flip(-1)
        return F.grid_sample(self.cells, place.view(1, -1, 1, 1, 3), align_corners=False,
                             padding_mode="border")[0, :, :, 0, 0].T
