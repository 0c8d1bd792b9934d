# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that has bounced between the token triangles, in closed form (docs/architecture.md).

Classic radiosity (Goral et al. 1984) with point-to-disk form factors: the light of lamps and sky, shadowed, is sent on
BOUNCES times without visibility, and from there on as if each bounce kept the same share of light; a surface point
gathers it. Form factors over a hemisphere sum to 1 at most: more is scaled down. Volumes take their part on the way.
"""
from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional as F

from ..progress import part, report
from ..scene import RenderScene
from .light_prior import LightPrior
from .patches import patches

BOUNCES = 2        # between triangles, before the last one at the point
CHUNK = 1024       # points at a time
ABOVE = 1e-3       # network units that a point is lifted off its surface
KEPT = 0.9         # of the light, at most, that a bounce keeps after the last one computed
WAYS = 32          # patches towards which a point looks for fog


class Radiosity:
    """Built from a normalised RenderScene and its LightPrior; the result is in the prior's radiance units."""

    def __init__(self, scene: RenderScene, prior: LightPrior):
        device = prior.radiance.device
        self.center, self.vector, albedo = (x.to(device) for x in patches(scene))
        self.area = self.vector.norm(dim=-1)
        self.fog = prior.fog
        if self.fog is not None:
            self.far = self.center[::max(len(self.center) // WAYS, 1)]
            self.murk = self.fog.around(self.center, self.far)
        facing = F.normalize(self.vector, dim=-1)
        x, n, albedo = torch.cat([self.center] * 2), torch.cat([facing, -facing]), torch.cat([albedo] * 2)
        with part(0.0, 0.5):
            arriving = prior.arriving(x, n)
        first = albedo * prior(x + ABOVE * n, n, n, torch.ones_like(x[:, 0]), arriving)[:, :3]
        self.leaving = first.view(2, -1, 3)  # radiance of the front and the back
        lights = [first]
        for bounce in range(BOUNCES):
            with part(0.5 + bounce / BOUNCES / 2, 0.5 + (bounce + 1) / BOUNCES / 2):
                lights.append(first + albedo * self(x, n))
                self.leaving = lights[-1].view(2, -1, 3)
        self.leaving = (lights[-1] + self._rest(*lights[-3:])).view(2, -1, 3)

    def _rest(self, *lights: Tensor) -> Tensor:
        """(2 S, 3) light of all bounces after three states (2 S, 3), as a geometric series."""
        before, added = lights[1] - lights[0], lights[2] - lights[1]
        area = torch.cat([self.area] * 2)
        kept = (area @ added / (area @ before).clamp_min(1e-12)).clamp(0, KEPT)
        return added * kept / (1 - kept)

    def __call__(self, position: Tensor, normal: Tensor) -> Tensor:
        """Radiance leaving a white diffuse surface at points (P, 3) with unit normals (P, 3) -> (P, 3)."""
        front, back = self.leaving
        parts = [torch.zeros_like(position[:0])]
        for x, n in zip(position.split(CHUNK), normal.split(CHUNK), strict=True):
            report((len(parts) - 1) * CHUNK / max(len(position), 1))
            weight = self._form_factors(x + ABOVE * n, n)
            covered = weight.abs().sum(1, keepdim=True)
            if self.fog is not None:
                murk = (self.fog.around(x, self.far) + self.murk.T) / 2
                weight.mul_((-murk * torch.cdist(x, self.center)).exp_())
            gathered = weight.clamp_min(0) @ (front + back) - weight @ back
            parts.append(gathered / covered.clamp_min(1.0))
        return torch.cat(parts)

    def _form_factors(self, x: Tensor, n: Tensor) -> Tensor:
        """(P, S) share of the hemisphere that each patch covers, negative where its back is seen."""
        dot = lambda a, b: (a * b).sum(-1, keepdim=True)  # noqa: E731
        c, v, one, ones = self.center, self.vector, torch.ones_like(x[:, :1]), torch.ones_like(self.center[:, :1])
        distance2 = torch.cat([x, dot(x, x), one], 1) @ torch.cat([-2 * c, ones, dot(c, c)], 1).T
        receiving = torch.cat([n, -dot(n, x)], 1) @ torch.cat([c, ones], 1).T
        sending = torch.cat([x, one], 1) @ torch.cat([v, -dot(c, v)], 1).T
        distance2.clamp_min_(1e-8)
        return receiving.clamp_min_(0).mul_(sending).div_(distance2.mul_(math.pi * distance2 + self.area))
