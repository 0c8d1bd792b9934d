# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays see through glass: the sky, dimmed. Light of lamps, which glass gathers, is in photons.py."""
from __future__ import annotations

import torch
from torch import Tensor

from ...progress import part
from ..direct.environment_light import BLUR, EnvironmentPrior
from ..edge_stopping import dot
from ..visibility import Visibility
from .patches import Patches

SURFACES = 2   # of glass that dim a ray
PASSED = 0.88  # share of light that a surface of glass, as blurred as for photons, lets through besides its colour
BEYOND = 1e-4  # network units behind a pane where a ray goes on


class Panes:
    """The triangles of glass of all patches."""

    def __init__(self, patches: Patches, environment: EnvironmentPrior | None, device: torch.device):
        self.environment, corners = environment, patches.corners[patches.glass].to(device)
        self.surfaces = Visibility(corners.cpu().numpy())
        every = corners.flatten(0, 1)
        self.center = (every.amin(0) + every.amax(0)) / 2  # of a sphere around all glass
        self.radius = (every - self.center).norm(dim=-1).max()
        self.tint = patches.tint[patches.glass].to(device)

    def through(self, origin: Tensor, direction: Tensor, distance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Which of N rays meet glass within their distances (N,): rows (M,).

        And (M, 3) radiance of the sky that these find through it, and (M,) the share of light from farther away that it
        lets pass.
        """
        rays = self._towards(origin, direction, distance).nonzero()[:, 0]  # a GPU is waited for here
        origin, direction, distance = (x[rays] for x in (origin, direction, distance))
        place, gone = None, 0.0
        for surface in range(SURFACES):
            begin = gone + BEYOND
            with part(surface / SURFACES, (surface + 1) / SURFACES):
                pane, way = self.surfaces.nearest(origin + begin * direction, direction)
            gone = begin + way[:, None]
            met = ((pane >= 0) & (gone[:, 0] < distance)).nonzero()[:, 0]  # a GPU is waited for here
            pane, gone, origin, direction, distance = (x[met] for x in (pane, gone, origin, direction, distance))
            if place is None:
                place, along, to_sky = torch.arange(len(met), device=met.device), direction, distance.isinf()
                rays = rays[met]
                passed = torch.ones_like(along)
            else:
                place = place[met]
            passed[place] *= PASSED * self.tint[pane]
        light = torch.zeros_like(along)
        if self.environment is not None:
            sky = self.environment.filtered(along, torch.full_like(along[:, 0], BLUR))
            light = passed * sky * to_sky[:, None]
        return rays, light, passed.mean(-1)

    def _towards(self, origin: Tensor, direction: Tensor, distance: Tensor) -> Tensor:
        """(N,) bool: rays that meet the sphere around all glass, as few do where that is a ball in a room."""
        away = self.center - origin
        along = dot(away.T, direction.T)
        aside2 = dot(away.T, away.T) - along.square()
        return (aside2 <= self.radius ** 2) & (along >= -self.radius) & (along - self.radius < distance)
