# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that let light pass straight, such as coloured panes without refraction, and what they take from it."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..scene import BASE_COLOR, METALLIC, TRANSMISSION, RenderScene, tint_of_glass
from ..scene_rays import scene_rays
from ..surface_kinds import STRAIGHT_THROUGH, Ray
from .tensor_rays import TensorRays

LAYERS = 8    # that dim a ray
CLEAR = 0.98  # tint from which on a surface is not there
GAP = 1e-4    # network units behind a surface where a ray goes on


class Cutouts:
    """All such surfaces of a scene, as rays towards lights meet them."""

    def __init__(self, surfaces: TensorRays, tint: Tensor):
        """tint: (G, 3) of all triangles of the geometry."""
        self._surfaces, self._tint = surfaces, tint

    @classmethod
    def of(cls, scene: RenderScene, device: torch.device | str) -> Cutouts | None:
        """None where none dims light."""
        rays = scene_rays(scene)
        rows = rays.rows(STRAIGHT_THROUGH, Ray.SHADOW)
        if not len(rows):
            return None
        tint = token_tints(scene)[scene.surfaces.token]
        if (tint[rows] > CLEAR).all():
            return None
        return cls(TensorRays(rays.among(STRAIGHT_THROUGH, Ray.SHADOW)), torch.from_numpy(tint).to(device))

    def transmittance(self, origin: Tensor, direction: Tensor, distance: Tensor) -> Tensor:
        """(N, 3) share of light that arrives at points (N, 3) from distances (N,) along unit vectors (N, 3)."""
        share = torch.ones_like(direction)
        row, travelled = torch.arange(len(origin), device=origin.device), torch.zeros_like(distance)
        for _ in range(LAYERS):
            if not len(row):
                break
            hits = self._surfaces.nearest(origin + travelled[:, None] * direction, direction)
            travelled = travelled + hits.distance
            hit = (travelled < distance).nonzero()[:, 0]  # waits for a GPU
            share[row[hit]] *= self._tint[hits.triangle[hit]]
            row, origin, direction, distance = (x[hit] for x in (row, origin, direction, distance))
            travelled = travelled[hit] + GAP
        return share


def token_tints(scene: RenderScene) -> np.ndarray:
    """(N, 3) f32 mean share of light that passes each token triangle."""
    means = scene.tiles.mean(axis=(2, 3), dtype=np.float32)
    tint = (1 - means[:, METALLIC, None]) * means[:, TRANSMISSION, None] * tint_of_glass(means[:, BASE_COLOR])
    return tint[scene.tile_index]
