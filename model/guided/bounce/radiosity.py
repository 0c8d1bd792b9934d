# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that has bounced between the token triangles: radiosity with visibility by rays.

Form factors between patches (Goral et al. 1984), and the light that arrives at a point (Reichert 1992, "A two-pass
radiosity method"), are estimated by rays. The direct light on the patches comes from the light prior. Light through
glass, where the prior does not reach, is found by the same rays.
"""
from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from ...progress import part
from ...scene import RenderScene
from ..prior.blocking import is_solid
from ..prior.light_prior import LightPrior
from ..visibility import Visibility
from .patches import patches

BOUNCES = 3      # between patches, before the last one at the point: together as many as Cycles' diffuse ones
PATCH_RAYS = 128  # from each side of a patch
RAYS = 96        # from a point
SURFACES = 2     # of glass that a ray looks for lamps at
PASSED = 0.9     # share of lamps' light that glass lets through besides its colour
ABOVE = 1e-3     # network units that a point is lifted off its surface
BEYOND = 1e-4    # network units behind a pane where a ray goes on
BLUR = 0.3       # roughness that spreads the environment's radiance over what a ray stands for
GOLDEN = (math.sqrt(5) - 1) / 2
MIX, SCATTER = [(1298.98, 2695.31), (7823.3, 1833.06), (3771.9, 2461.7)], 43758.5453
R2 = 0.7548776662, 0.5698402910  # steps of a sequence that fills a square evenly (Roberts 2018)


@dataclass
class Surroundings:
    """What R rays from each of P points meet."""

    side: Tensor     # (P, R) row of `Radiosity.leaving`, or the one behind
    passing: Tensor  # (P, R) share of the light that volumes let pass
    through: Tensor  # (P, 3) mean radiance of the sky and of lamps behind glass


class Radiosity:
    """Built from a normalised RenderScene and its LightPrior; the result is in the prior's radiance units."""

    def __init__(self, scene: RenderScene, prior: LightPrior):
        device = prior.radiance.device
        found = patches(scene)
        center, vector, albedo = (x.to(device) for x in (found.center, found.vector, found.albedo))
        shining = torch.from_numpy(scene.triangles[scene.is_light & is_solid(scene)])
        self.normal = F.normalize(vector, dim=-1)
        # Where nothing is met, and where emitters are, whose light is no bounced one, is the row behind all patches.
        self.patch = F.pad(found.patch[found.solid], (0, len(shining) + 1), value=len(center)).to(device)
        with part(0.0, 0.1):
            self.surfaces = Visibility(torch.cat([found.corners[found.solid], shining]).numpy())
        self.fog, self.environment, self.panes = prior.fog, prior.environment, None
        if found.glass.any():
            with part(0.1, 0.2):
                self.panes = Visibility(found.corners[found.glass].numpy())
            self.tint, self.pane = (a[found.glass].to(device) for a in (found.tint, found.patch))
        x, n, albedo = torch.cat([center] * 2), torch.cat([self.normal, -self.normal]), torch.cat([albedo] * 2)
        with part(0.2, 0.4):
            arriving = prior.arriving(x, n)
        with part(0.4, 0.5):
            first = albedo * prior(x + ABOVE * n, n, n, torch.ones_like(x[:, 0]), arriving)[:, :3]
        if self.panes is not None:
            lamps = arriving * arriving.new_tensor([0, 0, 0, 1, 1, 1])
            with part(0.5, 0.6):  # of all fronts, then of all backs, as of all that follows
                self.shining = prior(x, n, n, torch.ones_like(x[:, 0]), lamps)[:, :3]
        with part(0.6, 1.0):
            around = self._look(x, n, scattered(x), PATCH_RAYS)
        again = torch.zeros_like(first)
        for _ in range(BOUNCES):
            again = albedo * (around.through + _gathered(around, first + again))
        self.leaving = torch.cat([first + again, again], dim=1)  # all, and what had bounced before

    def __call__(self, position: Tensor, normal: Tensor, number: Tensor | None = None) -> Tensor:
        """Radiance leaving a white diffuse surface at points (P, 3) with unit normals (P, 3) -> (P, 6).

        The last three are the part that has bounced more than once.
        number: (P,) of neighbours in a row, whose rays go between each other's; by default they are a row.
        """
        number = torch.arange(len(position), device=position.device) if number is None else number
        around = self._look(position, normal, number[:, None] * position.new_tensor(R2) % 1, RAYS)
        return F.pad(around.through, (0, 3)) + _gathered(around, self.leaving)

    def _look(self, position: Tensor, normal: Tensor, start: Tensor, rays: int) -> Surroundings:
        direction = cosine_directions(normal, rays, start).reshape(-1, 3)
        origin = (position + ABOVE * normal)[:, None].expand(-1, rays, -1).reshape(-1, 3)
        with part(0.0, 0.7):
            triangle, distance = self.surfaces.nearest(origin, direction)
        patch, count = self.patch[triangle], len(self.normal)
        back = (F.pad(self.normal, (0, 0, 0, 1))[patch] * direction).sum(-1) > 0
        side = torch.where(patch < count, patch + count * back, 2 * count)
        passing, through = torch.ones_like(distance), torch.zeros_like(direction)
        if self.fog is not None:
            passing = self.fog.passing(origin, origin + distance.nan_to_num(posinf=0)[:, None] * direction)
        if self.panes is not None:
            with part(0.7, 1.0):
                through = self._through(origin, direction, distance)
        return Surroundings(side.view(-1, rays), passing.view(-1, rays), through.view(-1, rays, 3).mean(1))

    def _through(self, origin: Tensor, direction: Tensor, distance: Tensor) -> Tensor:
        """(N, 3) radiance of sky and lamps that rays find through glass within their distances (N,).

        Lamps light a surface of glass from the side that a ray leaves by: it spreads their light as if it were milky.
        """
        sky, lamps = torch.zeros_like(direction), torch.zeros_like(direction)
        ray, gone = torch.arange(len(origin), device=origin.device), torch.zeros_like(direction[:, :1])
        for surface in range(SURFACES):
            with part(surface / SURFACES, (surface + 1) / SURFACES):
                begin = gone + BEYOND
                pane, way = self.panes.nearest(origin[ray] + begin * direction[ray], direction[ray])
            gone = begin + way[:, None]
            met = (pane >= 0) & (gone[:, 0] < distance[ray])
            ray, pane, gone = ray[met], pane[met], gone[met]
            towards, tint, row = direction[ray], self.tint[pane]**2, self.pane[pane]  # a body's two surfaces
            if surface == 0 and self.environment is not None:
                seen = self.environment.filtered(towards, torch.full_like(gone[:, 0], BLUR))
                sky[ray] = seen * tint * distance[ray, None].isinf()
            from_behind = (self.normal[row] * towards).sum(-1) < 0
            lamps[ray] = torch.maximum(lamps[ray], tint * self.shining[row + len(self.normal) * from_behind])
        return sky + PASSED * lamps


def _gathered(around: Surroundings, leaving: Tensor) -> Tensor:
    """(P, C) mean of what arrives of the radiance (2 S, C) that leaves both sides of the patches."""
    leaving, count = F.pad(leaving, (0, 0, 0, 1)), around.side.shape[1]
    rays = zip(around.side.T, around.passing.T, strict=True)
    return sum(leaving.index_select(0, side) * share[:, None] for side, share in rays) / count


def scattered(position: Tensor) -> Tensor:
    """(P, 2) f32 in [0, 1), as if at random, but the same wherever a point (P, 3) stands among others."""
    mixed = position.cpu().double() @ torch.tensor(MIX, dtype=torch.float64)  # GPUs may know no float64
    return (mixed.sin() * SCATTER % 1).float().to(position.device)


def cosine_directions(normal: Tensor, count: int, start: Tensor) -> Tensor:
    """(P, count, 3) unit vectors around unit normals (P, 3), as dense as their cosines; `start` (P, 2) in [0, 1)."""
    k = torch.arange(count, device=normal.device)
    sine2 = (k + start[:, :1]) / count
    phi = 2 * math.pi * ((k * GOLDEN + start[:, 1:]) % 1)
    around = F.one_hot(normal.abs().argmin(-1), 3).to(normal.dtype)
    aside = F.normalize(torch.linalg.cross(normal, around), dim=-1)
    axes = torch.stack([aside, torch.linalg.cross(normal, aside), normal], dim=1)
    sine = sine2.sqrt()
    return torch.stack([sine * phi.cos(), sine * phi.sin(), (1 - sine2).clamp_min(1e-4).sqrt()], -1) @ axes
