# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays from points meet: sides of patches, the sky, and light behind glass."""
from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from ...progress import part
from ...scene import RenderScene
from ..prior.blocking import is_solid
from ..prior.environment_prior import BLUR, EnvironmentPrior
from ..prior.transmittance import Fog
from ..visibility import Visibility
from .patches import Patches

SURFACES = 2     # of glass that a ray looks for lamps at
PASSED = 0.9     # share of lamps' light that glass lets through besides its colour
FOGLESS = 2.0    # network units from a point: nobody looks for fog beyond
ABOVE = 1e-3     # network units that a point is lifted off its surface
BEYOND = 1e-4    # network units behind a pane where a ray goes on


@dataclass
class Surroundings:
    """What R rays from each of P points meet."""

    direction: Tensor  # (P, R, 3)
    side: Tensor       # (P, R) row of a patch's front or back among those of all; the one behind = none
    passing: Tensor    # (P, R) share of the light that volumes let pass
    sky: Tensor        # (P, R) bool: nothing is met
    through: Tensor    # (P, 3) mean radiance of the sky and of lamps behind glass

    def together(self, count: int) -> Surroundings:
        """As if every `count` points, one after the other, were one."""
        of_rays = self.direction, self.side, self.passing, self.sky
        joined = (x.view(-1, count * x.shape[1], *x.shape[2:]) for x in of_rays)
        return Surroundings(*joined, self.through.view(-1, count, 3).mean(1))

    def gathered(self, leaving: Tensor, weight: Tensor | None = None) -> Tensor:
        """(P, C) mean of what arrives of the radiance (sides, C) that leaves the patches.

        weight: (P, R) of the rays, whose mean is 1.
        """
        leaving, count = F.pad(leaving, (0, 0, 0, 1)), self.side.shape[1]
        share = self.passing if weight is None else self.passing * weight
        rays = zip(self.side.T, share.T, strict=True)
        return sum(leaving.index_select(0, side) * share[:, None] for side, share in rays) / count

    def sky_share(self, environment: EnvironmentPrior | None) -> Tensor:
        """(P, 3) share of the environment's light that arrives, by its colour."""
        if environment is None:
            return torch.ones_like(self.through)
        return environment.share(self.direction, self.sky * self.passing)


class Interior:
    """All patches of a scene, for rays to meet. Where they find glass, `shining` (sides, 3) is looked up."""

    def __init__(self, scene: RenderScene, patches: Patches, fog: Fog | None, environment: EnvironmentPrior | None,
                 device: torch.device):
        shining = torch.from_numpy(scene.triangles[scene.is_light & is_solid(scene)])
        self.normal = F.normalize(patches.vector.to(device), dim=-1)
        # Where nothing is met, and where emitters are, whose light is no bounced one, is the row behind all patches.
        self.patch = F.pad(patches.patch[patches.solid], (0, len(shining) + 1), value=len(self.normal)).to(device)
        self.fog, self.environment, self.panes, self.shining = fog, environment, None, None
        with part(0.0, 0.5):
            self.surfaces = Visibility(torch.cat([patches.corners[patches.solid], shining]).numpy())
        if patches.glass.any():
            with part(0.5, 1.0):
                self.panes = Visibility(patches.corners[patches.glass].numpy())
            self.tint, self.pane = (a[patches.glass].to(device) for a in (patches.tint, patches.patch))

    def look(self, position: Tensor, normal: Tensor, direction: Tensor) -> Surroundings:
        """From points (P, 3), a little above their normals, along unit vectors (P, R, 3)."""
        rays, direction = direction.shape[1], direction.reshape(-1, 3)
        origin = (position + ABOVE * normal)[:, None].expand(-1, rays, -1).reshape(-1, 3)
        with part(0.0, 0.7):
            triangle, distance = self.surfaces.nearest(origin, direction)
        patch, count = self.patch[triangle], len(self.normal)
        back = (F.pad(self.normal, (0, 0, 0, 1))[patch] * direction).sum(-1) > 0
        side = torch.where(patch < count, patch + count * back, 2 * count)
        passing, through, sky = torch.ones_like(distance), torch.zeros_like(direction), distance.isinf()
        if self.fog is not None:
            passing = self.fog.passing(origin, origin + distance.clamp(max=FOGLESS)[:, None] * direction)
        if self.panes is not None:
            with part(0.7, 1.0):
                through, share, clear = self._through(origin, direction, distance)
            sky, passing = sky & clear, passing * share
        return Surroundings(direction.view(-1, rays, 3), *(a.view(-1, rays) for a in (side, passing, sky)),
                            through.view(-1, rays, 3).mean(1))

    def _through(self, origin: Tensor, direction: Tensor, distance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """(N, 3) radiance of sky and lamps that rays find through glass within their distances (N,).

        And (N,) the share of the light from farther away that it lets pass, and which rays meet none.

        Lamps light a surface of glass from the side that a ray leaves by: it spreads their light as if it were milky.
        """
        lamps, passed = torch.zeros_like(direction), torch.ones_like(direction)
        clear = torch.ones_like(distance).bool()
        ray, gone = torch.arange(len(origin), device=origin.device), torch.zeros_like(direction[:, :1])
        for surface in range(SURFACES):
            with part(surface / SURFACES, (surface + 1) / SURFACES):
                begin = gone + BEYOND
                pane, way = self.panes.nearest(origin[ray] + begin * direction[ray], direction[ray])
            gone = begin + way[:, None]
            met = (pane >= 0) & (gone[:, 0] < distance[ray])
            ray, pane, gone = ray[met], pane[met], gone[met]
            row = self.pane[pane]
            from_behind = (self.normal[row] * direction[ray]).sum(-1) < 0
            passed[ray] *= self.tint[pane]
            lamps[ray] = torch.maximum(lamps[ray], passed[ray] * self.shining[row + len(self.normal) * from_behind])
            clear[ray] = False
        light, seen = PASSED * lamps, distance.isinf() & ~clear
        if self.environment is not None:
            sky = self.environment.filtered(direction[seen], torch.full_like(distance[seen], BLUR))
            light[seen] += passed[seen] * sky
        return light, torch.where(clear, 1.0, passed.mean(-1)), clear
