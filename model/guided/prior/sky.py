# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of the environment's light reaches a surface past the scene's triangles and through its volumes."""
from __future__ import annotations

import math

import torch
from torch import Tensor

from ...progress import part
from .environment_prior import EnvironmentPrior
from .far import FarBlockers
from .shadow_maps import DistantShadows
from .transmittance import Fog

DIRECTIONS = 64
BLUR = 0.5      # roughness that spreads the environment's radiance over a direction's share of the sphere
FOGLESS = 2.0   # network units from a point: nobody looks for fog beyond
CHUNK = 4096    # points at a time


class SkyVisibility:
    """Built from (T, 3, 3) corners of the triangles near, from what is far, and the volumes, that stand in the way."""

    def __init__(self, near: Tensor, far: FarBlockers, environment: EnvironmentPrior, fog: Fog | None = None):
        self.towards = sphere_directions(DIRECTIONS).to(near.device)
        self.radiance = environment.filtered(self.towards, torch.full_like(self.towards[:, 0], BLUR))
        with part(0.0, 0.2):
            self.unblocked = far.unblocked(self.towards)
        with part(0.2, 1.0):
            self.shadows, self.fog = DistantShadows(near, self.towards), fog

    def __call__(self, position: Tensor, normal: Tensor) -> Tensor:
        """(P, 3) share of the environment's RGB irradiance that arrives at points (P, 3) with unit normals (P, 3)."""
        parts = [torch.zeros_like(position[:0])]
        for x, n in zip(position.split(CHUNK), normal.split(CHUNK), strict=True):
            cosine, seen = (n @ self.towards.T).clamp_min(0), self.shadows(x, n) * self.unblocked
            if self.fog is not None:
                seen *= self.fog.passing(x[:, None], x[:, None] + FOGLESS * self.towards)
            parts.append((cosine * seen) @ self.radiance / (cosine @ self.radiance).clamp_min(1e-12))
        return torch.cat(parts)


def sphere_directions(count: int) -> Tensor:
    """(count, 3) unit vectors spread evenly: a Fibonacci lattice."""
    k = torch.arange(count) + 0.5
    z, phi = 1 - 2 * k / count, math.pi * (3 - math.sqrt(5)) * k
    flat = (1 - z * z).sqrt()
    return torch.stack([flat * phi.cos(), flat * phi.sin(), z], dim=-1)
