# SPDX-License-Identifier: GPL-3.0-or-later
"""The sky behind glass, as gather rays see it. Light of emitters, which glass focuses, is in caustics/photons.py."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...progress import part
from ...scene import BASE_COLOR, METALLIC, TRANSMISSION, RenderScene, tint_of_glass
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING
from ..direct.environment_light import BLUR, EnvironmentLight
from ..edge_stopping import dot
from ..tensor_rays import TensorRays

SURFACES = 2          # of glass that dim a ray
TRANSMITTANCE = 0.88  # of a surface of glass, as blurred as for photons, besides its colour
GAP = 1e-4            # network units behind a pane where a ray goes on


class Panes:
    """All glass of a scene."""

    def __init__(self, scene: RenderScene, environment: EnvironmentLight | None, device: torch.device):
        rays = scene_rays(scene)
        self.environment, self.surfaces = environment, TensorRays(rays.among(BENDING))
        points = torch.from_numpy(scene.surfaces.triangles[rays.rows(BENDING)]).to(device).flatten(0, 1)
        self.center = (points.amin(0) + points.amax(0)) / 2  # of a sphere around all glass
        self.radius = (points - self.center).norm(dim=-1).max()
        self._tint, self._token = (torch.from_numpy(x).to(device) for x in (token_tints(scene), scene.surfaces.token))

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
                pane, step, _ = self.surfaces.nearest(origin + begin * direction, direction)
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
            transmittance[row] *= TRANSMITTANCE * self._tint[self._token[pane]]
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


def token_tints(scene: RenderScene) -> np.ndarray:
    """(N, 3) f32 mean share of light that passes each token triangle."""
    means = scene.tiles.mean(axis=(2, 3), dtype=np.float32)
    tint = (1 - means[:, METALLIC, None]) * means[:, TRANSMISSION, None] * tint_of_glass(means[:, BASE_COLOR])
    return tint[scene.tile_index]
