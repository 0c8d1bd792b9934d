# SPDX-License-Identifier: GPL-3.0-or-later
"""The share of the environment's light that reaches a surface: not blocked by triangles, dimmed by volumes."""
from __future__ import annotations

import math

import torch
from torch import Tensor

from ...threads import shared
from ..visibility import Visibility
from .environment_prior import EnvironmentPrior
from .transmittance import Fog

DIRECTIONS = 64
BLUR = 0.35     # roughness that spreads the environment's radiance over a direction's share of the sphere
ABOVE = 2e-3    # network units that a ray starts off its surface
FOGLESS = 2.0   # network units from a point: nobody looks for fog beyond
CHUNK = 4096    # points at a time


class SkyVisibility:
    """Rays that miss: in DIRECTIONS of the whole sphere, weighted by cosine and the environment's radiance."""

    def __init__(self, blockers: Visibility, environment: EnvironmentPrior, fog: Fog | None = None):
        self.towards = sphere_directions(DIRECTIONS).to(environment.harmonics.device)
        self.radiance = environment.filtered(self.towards, torch.full_like(self.towards[:, 0], BLUR))
        self.blockers, self.fog = blockers, fog

    def __call__(self, position: Tensor, normal: Tensor) -> Tensor:
        """(P, 3) share of the environment's RGB irradiance that arrives at points (P, 3) with unit normals (P, 3)."""
        return torch.cat(shared(self._share, position.split(CHUNK), normal.split(CHUNK)))

    def _share(self, x: Tensor, n: Tensor) -> Tensor:
        cosine = (n @ self.towards.T).clamp_min(0)
        point, direction = cosine.nonzero().unbind(1)
        blocked = self.blockers.blocked((x + ABOVE * n)[point], self.towards[direction])
        seen = cosine.index_put((point, direction), cosine[point, direction] * ~blocked)
        if self.fog is not None:
            seen *= self.fog.passing(x[:, None], x[:, None] + FOGLESS * self.towards)
        return seen @ self.radiance / (cosine @ self.radiance).clamp_min(1e-12)


def sphere_directions(count: int) -> Tensor:
    """(count, 3) unit vectors spread evenly: a Fibonacci lattice."""
    k = torch.arange(count) + 0.5
    z, phi = 1 - 2 * k / count, math.pi * (3 - math.sqrt(5)) * k
    flat = (1 - z * z).sqrt()
    return torch.stack([flat * phi.cos(), flat * phi.sin(), z], dim=-1)
