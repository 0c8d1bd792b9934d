# SPDX-License-Identifier: GPL-3.0-or-later
"""The sky behind glass, as gather rays see it. Light of emitters, which glass focuses, is in caustics/photons.py."""
from __future__ import annotations

import torch
from torch import Tensor

from ...progress import part
from ..direct.environment_light import BLUR, EnvironmentLight
from ..edge_stopping import dot
from ..tensor_rays import TensorRays
from .patches import Patches

SURFACES = 2          # of glass that dim a ray
TRANSMITTANCE = 0.88  # of a surface of glass, as blurred as for photons, besides its colour
GAP = 1e-4            # network units behind a pane where a ray goes on


class Panes:
    """The glass triangles of all patches."""

    def __init__(self, patches: Patches, environment: EnvironmentLight | None, device: torch.device):
        self.environment, corners = environment, patches.corners[patches.glass].to(device)
        self.surfaces = TensorRays(corners.cpu().numpy())
        points = corners.flatten(0, 1)
        self.center = (points.amin(0) + points.amax(0)) / 2  # of a sphere around all glass
        self.radius = (points - self.center).norm(dim=-1).max()
        self.tint = patches.tint[patches.glass].to(device)

    def sky_through(self, origin: Tensor, direction: Tensor, distance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Which of N rays hit glass within their distances (N,), as rows (M,), and what they see behind it.

        Also returns the radiance of the sky (M, 3) that arrives through the glass, and its mean transmittance (M,).
        """
        ray = self._near_glass(origin, direction, distance).nonzero()[:, 0]  # waits for a GPU
        origin, direction, distance = (x[ray] for x in (origin, direction, distance))
        row, travelled = None, 0.0
        for surface in range(SURFACES):
            begin = travelled + GAP
            with part(surface / SURFACES, (surface + 1) / SURFACES):
                pane, step = self.surfaces.nearest(origin + begin * direction, direction)
            travelled = begin + step[:, None]
            hit = ((pane >= 0) & (travelled[:, 0] < distance)).nonzero()[:, 0]  # waits for a GPU
            pane, travelled, origin, direction, distance = (x[hit] for x in (pane, travelled, origin, direction,
                                                                             distance))
            if row is None:
                row, along, to_sky = torch.arange(len(hit), device=hit.device), direction, distance.isinf()
                ray = ray[hit]
                transmittance = torch.ones_like(along)
            else:
                row = row[hit]
            transmittance[row] *= TRANSMITTANCE * self.tint[pane]
        light = torch.zeros_like(along)
        if self.environment is not None:
            sky = self.environment.filtered(along, torch.full_like(along[:, 0], BLUR))
            light = transmittance * sky * to_sky[:, None]
        return ray, light, transmittance.mean(-1)

    def _near_glass(self, origin: Tensor, direction: Tensor, distance: Tensor) -> Tensor:
        """(N,) bool: rays that hit the sphere around all glass, as few do where that is a ball in a room."""
        to_center = self.center - origin
        along = dot(to_center.T, direction.T)
        aside2 = dot(to_center.T, to_center.T) - along.square()
        return (aside2 <= self.radius ** 2) & (along >= -self.radius) & (along - self.radius < distance)
