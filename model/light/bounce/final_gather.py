# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays from points meet: sides of patches, the sky, and that behind glass."""
from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from ...progress import part
from ...scene import RenderScene
from ..direct.direct_light import LightPrior
from ..direct.environment_light import EnvironmentPrior
from ..edge_stopping import dot
from ..occluders import is_solid
from ..visibility import Visibility
from ..weighted_rows import weighted_rows
from .bright_patches import Beacons
from .panes import Panes
from .patches import Patches

FOGLESS = 2.0    # network units from a point: nobody looks for fog beyond
ABOVE = 1e-3     # network units that a point is lifted off its surface
COVERED = 1e-3   # how much a point that sees nothing but backs says beside one that sees none
HAZE = 8, 8      # rays of a point that look for light that volumes scatter, and places on each
UNLIKE = 0.25    # difference of the shares of the sky that two points see at which one says 1/e about the other


@dataclass
class Surroundings:
    """What R rays from each of P points meet."""

    direction: Tensor  # (P, R, 3)
    side: Tensor       # (P, R + A) row of a patch's front or back among those of all; the one behind = none
    share: Tensor      # (P, R + A) of the light from there that arrives, R + A times; A rays more are aimed at beacons
    sky: Tensor        # (P, R) share of the light that arrives where nothing is met
    through: Tensor    # (P, 3) mean radiance of volumes, and of the sky behind glass

    def together(self, weight: Tensor) -> Surroundings:
        """As if every K points, one after the other, were one; weight: (P / K, K), whose means are 1."""
        count, each = weight.shape[1], weight.reshape(-1, 1)
        of_rays = self.direction, self.side, each * self.share, each * self.sky
        joined = (x.reshape(-1, count * x.shape[1], *x.shape[2:]) for x in of_rays)
        return Surroundings(*joined, (each * self.through).view(-1, count, 3).mean(1))

    def gathered(self, leaving: Tensor, weight: Tensor | None = None) -> Tensor:
        """(P, C) mean of what arrives of the radiance (sides, C) that leaves the patches.

        weight: (P, R) of the rays, whose mean is 1.
        """
        share = self.share if weight is None else self.share * weight
        return weighted_rows(F.pad(leaving, (0, 0, 0, 1)), self.side, share) / self.side.shape[1]

    def sky_share(self, environment: EnvironmentPrior | None, weight: Tensor | None = None) -> Tensor:
        """(P, 3) share of the environment's light that arrives, by its colour; weight as above."""
        if environment is None:
            return torch.ones_like(self.through)
        return environment.share(self.direction, self.sky, weight)


class Interior:
    """All patches of a scene, for rays to meet."""

    def __init__(self, scene: RenderScene, patches: Patches, prior: LightPrior):
        device = prior.radiance.device
        shining = torch.from_numpy(scene.triangles[scene.is_light & is_solid(scene)])
        self.normal = F.normalize(patches.vector.to(device), dim=-1)
        # Where nothing is met, and where emitters are, whose light is no bounced one, is the row behind all patches.
        self.patch = F.pad(patches.patch[patches.solid], (0, len(shining) + 1), value=len(self.normal)).to(device)
        self.corners, self.beacons = patches.corners[patches.solid].to(device), None
        self.fog, self.in_scattering, self.environment = prior.fog, prior.in_scattering, prior.environment
        self.panes = None
        with part(0.0, 0.5):
            self.surfaces = Visibility(torch.cat([patches.corners[patches.solid], shining]).numpy())
        if patches.glass.any():
            with part(0.5, 1.0):
                self.panes = Panes(patches, self.environment, device)

    def aim(self, worth: Tensor) -> None:
        """From now on at patches of such worth (sides,)."""
        self.beacons = Beacons(self.corners, self.patch[:len(self.corners)], worth)

    def look(self, position: Tensor, normal: Tensor, direction: Tensor, aimed: int = 0,
             start: Tensor | None = None, hazy: bool = True) -> Surroundings:
        """From points (P, 3), a little above their normals, along unit vectors (P, R, 3).

        If these are as dense as the cosine, `aimed` more may go towards beacons, which `start` (P, 2) spreads.
        hazy: whether light that volumes scatter on the way is found.
        """
        rays, target = direction.shape[1], None
        position = position + ABOVE * normal
        if aimed and self.beacons.lit:
            towards, target = self.beacons.aimed(position, aimed, start)
            direction = torch.cat([direction, towards], 1)
        every, direction = direction.shape[1], direction.reshape(-1, 3)
        origin = position[:, None].expand(-1, every, -1).reshape(-1, 3)
        with part(0.0, 0.7):
            triangle, distance = self.surfaces.nearest(origin, direction)
        side = self.met(triangle, direction)
        passing, sky = torch.ones_like(distance), distance.isinf()
        through = torch.zeros_like(position)
        if self.fog is not None:
            ends = origin + distance.clamp(max=FOGLESS)[:, None] * direction
            passing = self.fog.passing(origin, ends)
            if hazy:
                through += self._scattered(*(each.view(-1, every, 3)[:, :rays] for each in (origin, ends)))
        if self.panes is not None:
            with part(0.7, 1.0):
                met, light, share = self.panes.through(origin, direction, distance)
            sky[met] = False
            passing[met] *= share
            through.index_add_(0, met // every, light * (met % every < rays)[:, None] / rays)
        sky = (sky * passing).view(-1, every)[:, :rays]
        if target is not None:
            density = self.beacons.per_angle(triangle, direction, distance).view(-1, every)
            cosine = (direction.view(-1, every, 3) @ normal[..., None])[..., 0].clamp_min(0)
            balanced = every * cosine / (rays * cosine + math.pi * aimed * density).clamp_min(1e-9)
            balanced[:, rays:] *= triangle.view(-1, every)[:, rays:] == target
            passing = passing * balanced.flatten()
        return Surroundings(direction.view(-1, every, 3)[:, :rays], side.view(-1, every), passing.view(-1, every), sky,
                            through)

    def met(self, triangle: Tensor, direction: Tensor) -> Tensor:
        """(N,) side of a patch that rays meet which hit triangles (N,) along (N, 3), as Surroundings has it."""
        patch, count = self.patch[triangle], len(self.normal)
        back = dot(F.pad(self.normal, (0, 0, 0, 1)).index_select(0, patch).T, direction.T) > 0
        return torch.where(patch < count, patch + count * back, 2 * count)

    def _scattered(self, origin: Tensor, end: Tensor) -> Tensor:
        """(P, 3) mean radiance that volumes send from the ends of rays (P, R, 3) to their origins, by some of them."""
        rays, steps = HAZE
        step = max(origin.shape[1] // rays, 1)
        origin, end = origin[:, ::step], end[:, ::step]
        return self.in_scattering(origin.flatten(0, 1), end.flatten(0, 1), steps).view_as(origin).mean(1)

    def telling(self, around: Surroundings, count: int) -> Tensor:
        """(P / count, count) how much each of `count` points in a row says about their patch, 1 in the mean.

        Points that something covers, as walls cover the rim of a floor, see the insides of that: backs. And few that
        see more of the sky than the others are on the other side of a wall.
        """
        side = around.side[:, :around.direction.shape[1]]
        behind = (side >= len(self.normal)) & (side < 2 * len(self.normal))
        backs, sky = ((x > 0).to(around.share.dtype).mean(1).view(-1, count) for x in (behind, around.sky))
        unlike = (sky - sky.median(1, keepdim=True).values) / UNLIKE
        says = (1 - backs).clamp_min(COVERED) * (-unlike.square()).exp()
        return says / says.mean(1, keepdim=True)
