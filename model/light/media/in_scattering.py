# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of emitters and sky that media scatter once to the camera and to surfaces, as Cycles does by default."""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional as F

from ..chunks import in_chunks
from ..direct.emitter_light import EmitterLight
from ..sampling import hashed_starts
from .lamp_glow import LampGlow
from .lit_cells import LitCells
from .ray_march import march
from .transmittance import SIDE, Fog

STEPS = 24   # along a ray of a viewer
POINTS = 6   # of a cell, at which emitters light it
LAMPS = 8    # whose glow is computed by itself, the strongest
CHUNK = 8192  # points, or rays, at a time

RadianceInAir = Callable[[Tensor], Tensor]  # of points (P, 3): (P, 3), the mean over all directions


class InScattering:
    """What the cells of a fog send in all directions, computed once for all views."""

    def __init__(self, fog: Fog, sky: RadianceInAir, emitters: EmitterLight):
        cells = fog.scattering.amax(1).nonzero()[:, 0]
        middle = fog.points_in(cells, torch.full((len(cells), 3), 0.5, device=cells.device))
        points = [fog.points_in(cells, hashed_starts(middle + k, 3)) for k in range(POINTS)]
        lamps, others = emitters.strongest_lamps(LAMPS)

        def mean(radiance: RadianceInAir) -> Tensor:
            light = sum(in_chunks(CHUNK, radiance, x) for x in points) / POINTS
            return torch.zeros_like(fog.scattering).index_put((cells,), light)

        light = mean(others.radiance_in_air)
        light[cells] += sky(fog.points_in(cells, hashed_starts(middle, 3)))
        self._fog = fog
        self._beside_lamps = fog.as_volume(torch.cat([light * fog.scattering, fog.extinction], dim=1))
        self._lamps = []
        for lamp in lamps:
            arriving = mean(lamp.radiance_in_air)
            self._lamps.append(LampGlow(fog, lamp, _shares(arriving, mean(lamp.unshadowed_in_air))))
            light = light + arriving
        self.to_surfaces = LitCells(fog, light * fog.scattering)
        # What the cells send out by themselves; None if that is nothing
        self.fire = None if fog.emission is None else LitCells(fog, fog.emission)

    def towards_viewer(self, origin: Tensor, end: Tensor) -> Tensor:
        """(P, 3) radiance that arrives at points (P, 3) from the media before the points `end` (P, 3)."""
        return in_chunks(CHUNK, self._towards_viewer, origin, end)

    def _towards_viewer(self, origin: Tensor, end: Tensor) -> Tensor:
        def sent_at(x: Tensor, _: Tensor) -> tuple[Tensor, Tensor]:
            return self._fog.interpolated(self._beside_lamps, x).tensor_split([3], dim=1)

        found = march(self._fog, sent_at, origin, end, STEPS)
        direction = F.normalize(end - origin, dim=1)
        return found.radiance + sum(lamp(origin, direction, found.begin, found.begin + STEPS * found.length,
                                         found.transmittance) for lamp in self._lamps)


def _shares(arriving: Tensor, unshadowed: Tensor) -> Tensor:
    """(SIDE^3, 3) share of the light of cells that arrives; where there is none, that of the cells around."""
    is_lit = unshadowed > 0
    share = torch.where(is_lit, arriving / unshadowed.clamp_min(1e-20), 0.0)
    summed, count = (F.avg_pool3d(x.T.reshape(1, 3, SIDE, SIDE, SIDE), 3, 1, 1).reshape(3, -1).T
                     for x in (share, is_lit.to(share)))
    return torch.where(is_lit, share, summed / count.clamp_min(1e-20))
