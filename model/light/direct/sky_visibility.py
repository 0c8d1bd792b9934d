# SPDX-License-Identifier: GPL-3.0-or-later
"""The share of the environment's light that reaches a surface: not blocked by triangles, dimmed by volumes."""
from __future__ import annotations

from functools import partial

import torch
from torch import Tensor

from ...compute.threads import shared
from ..media.transmittance import Fog
from ..sampling import cosine_directions
from ..visibility import Visibility
from .environment_light import EnvironmentPrior

ABOVE = 2e-3    # network units that a ray starts off its surface
FOGLESS = 2.0   # network units from a point: nobody looks for fog beyond
CHUNK = 4096    # points at a time


class SkyVisibility:
    """Rays that miss, weighted by the environment's radiance."""

    def __init__(self, blockers: Visibility, environment: EnvironmentPrior, fog: Fog | None = None):
        self.blockers, self.environment, self.fog = blockers, environment, fog

    def __call__(self, position: Tensor, normal: Tensor, start: Tensor, rays: int) -> Tensor:
        """(P, 3) share of the environment's RGB irradiance that arrives at points (P, 3) with unit normals (P, 3).

        start: (P, 2) in [0, 1), as of `cosine_directions`.
        """
        chunks = zip(*(x.split(CHUNK) for x in (position, normal, start)), strict=True)
        return torch.cat(shared(partial(self._share, rays), *zip(*chunks, strict=True)))

    def _share(self, rays: int, x: Tensor, n: Tensor, start: Tensor) -> Tensor:
        towards = cosine_directions(n, rays, start)
        origin = (x + ABOVE * n)[:, None].expand_as(towards).reshape(-1, 3)
        seen = (~self.blockers.blocked(origin, towards.reshape(-1, 3))).view(-1, rays).to(x.dtype)
        if self.fog is not None:
            seen = seen * self.fog.passing(x[:, None], x[:, None] + FOGLESS * towards)
        return self.environment.share(towards, seen)
