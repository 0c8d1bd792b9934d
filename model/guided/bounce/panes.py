# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays see through glass: the sky, dimmed, and lamps, whose light it spreads."""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ...progress import part
from ..prior.environment_prior import BLUR, EnvironmentPrior
from ..visibility import Visibility
from .patches import Patches

SURFACES = 2     # of glass that a ray looks for lamps at
PASSED = 0.9     # share of lamps' light that glass lets through besides its colour
LOBE = 6.0       # power of the cosine with the way straight on by which smooth glass spreads it; rough, all around
UPRIGHT = 0.125  # cosine between that way and the surface, at least: what leaves along a surface is little
BEYOND = 1e-4    # network units behind a pane where a ray goes on


class Panes:
    """The triangles of glass of all patches; what lamps light them with is found later."""

    def __init__(self, patches: Patches, normal: Tensor, environment: EnvironmentPrior | None):
        """normal: (S, 3), unit, of the patches."""
        self.normal, self.environment = normal, environment
        self.surfaces = Visibility(patches.corners[patches.glass].numpy())
        self.tint, self.patch, roughness = (
            of[patches.glass].to(normal.device) for of in (patches.tint, patches.patch, patches.roughness))
        self.power = LOBE * (1 - roughness[:, None]).square()
        self.shining = self.towards = normal.new_zeros(2 * len(normal), 3)

    def light(self, shining: Tensor, towards: Tensor) -> None:
        """Lamps make the sides of patches shine so (sides, 3), and light them from directions (sides, 3)."""
        self.shining, self.towards = shining, F.normalize(towards, dim=-1)

    def through(self, origin: Tensor, direction: Tensor, distance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Which of N rays meet glass within their distances (N,): rows (M,).

        And (M, 3) radiance of sky and lamps that these find through it, and (M,) the share of the light from farther
        away that it lets pass.
        """
        rays, gone = None, 0.0
        for surface in range(SURFACES):
            begin = gone + BEYOND
            with part(surface / SURFACES, (surface + 1) / SURFACES):
                pane, way = self.surfaces.nearest(origin + begin * direction, direction)
            gone = begin + way[:, None]
            met = ((pane >= 0) & (gone[:, 0] < distance)).nonzero()[:, 0]  # a GPU is waited for here
            pane, gone, origin, direction, distance = (x[met] for x in (pane, gone, origin, direction, distance))
            if rays is None:
                rays, place, along, to_sky = met, torch.arange(len(met), device=met.device), direction, distance.isinf()
                lamps, passed = torch.zeros_like(along), torch.ones_like(along)
            else:
                place = place[met]
            passed[place] *= self.tint[pane]
            lamps[place] = torch.maximum(lamps[place], passed[place] * self._spread(pane, direction))
        light = PASSED * lamps
        if self.environment is not None:
            sky = self.environment.filtered(along, torch.full_like(along[:, 0], BLUR))
            light += passed * sky * to_sky[:, None]
        return rays, light, passed.mean(-1)

    def _spread(self, pane: Tensor, direction: Tensor) -> Tensor:
        """(N, 3) radiance of the lamps' light on the side that rays along unit vectors (N, 3) leave glass by.

        A lobe around the way straight on, of as much light in all as a milky surface would spread.
        """
        row = self.patch[pane]
        normal, power = self.normal[row], self.power[pane]
        out = row + len(self.normal) * ((normal * direction).sum(-1) < 0)
        towards = self.towards[out]
        along = (towards * direction).sum(-1, keepdim=True).clamp_min(0)
        upright = (towards * normal).sum(-1, keepdim=True).abs().clamp_min(UPRIGHT)
        return self.shining[out] * along ** power * (power + 1).square() / (1 + 2 * power * upright)
