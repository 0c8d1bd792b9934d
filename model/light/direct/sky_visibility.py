# SPDX-License-Identifier: GPL-3.0-or-later
"""The share of the environment's light that reaches a surface: not blocked by triangles, dimmed by media."""
from __future__ import annotations

from functools import partial

from torch import Tensor

from ..chunks import in_chunks
from ..media.transmittance import Fog
from ..sampling import cosine_directions
from ..tensor_rays import TensorRays
from .environment_light import EnvironmentLight

LIFT = 2e-3      # network units that a ray starts off its surface
FOG_REACH = 2.0  # network units from a point: fog beyond dims nothing
CHUNK = 4096     # points at a time


class SkyVisibility:
    """Rays that miss all occluders, weighted by the environment's radiance."""

    def __init__(self, occluders: TensorRays, environment: EnvironmentLight, fog: Fog | None = None):
        self.occluders, self.environment, self.fog = occluders, environment, fog

    def __call__(self, position: Tensor, normal: Tensor, start: Tensor, rays: int) -> Tensor:
        """(P, 3) share of the environment's RGB irradiance that arrives at points (P, 3) with unit normals (P, 3).

        start: (P, 2) in [0, 1), as of `cosine_directions`.
        """
        return in_chunks(CHUNK, partial(self._trace, rays), position, normal, start)

    def _trace(self, rays: int, x: Tensor, n: Tensor, start: Tensor) -> Tensor:
        direction = cosine_directions(n, rays, start)
        origin = (x + LIFT * n)[:, None].expand_as(direction).reshape(-1, 3)
        visible = (~self.occluders.is_blocked(origin, direction.reshape(-1, 3))).view(-1, rays).to(x.dtype)
        if self.fog is not None:
            visible = visible * self.fog.transmittance(x[:, None], x[:, None] + FOG_REACH * direction)
        return self.environment.visible_share(direction, visible)
