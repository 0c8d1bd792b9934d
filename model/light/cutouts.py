# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that let light pass straight, such as coloured panes without refraction, and what they take from it."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..rays import Rays
from ..scene import BASE_COLOR, METALLIC, TRANSMISSION, RenderScene, tint_of_glass
from ..scene_rays import scene_rays
from ..surface_kinds import STRAIGHT_THROUGH, Ray
from .tensor_rays import TensorRays

LAYERS = 8    # that dim a ray
CLEAR = 0.98  # tint from which on a surface is not there
GAP = 1e-4    # network units behind a surface where a ray goes on


class Cutouts:
    """All such surfaces of a scene that rays of a kind meet."""

    def __init__(self, surfaces: Rays, tint: Tensor):
        """tint: (K, 3) of the triangles of `surfaces`."""
        self._surfaces, self._tint = TensorRays(surfaces), tint

    @classmethod
    def of(cls, scene: RenderScene, ray: Ray, device: torch.device | str) -> Cutouts | None:
        """Those that such rays meet; None where none dims light."""
        rows, passed = scene_rays(scene).rows(STRAIGHT_THROUGH, ray), np.full(len(scene), -1)
        if ray is Ray.SHADOW:
            passed = scene.seldom("shadow_tile")
            rows = np.union1d(rows, np.flatnonzero(passed[scene.surfaces.token] >= 0))
        if not len(rows):
            return None
        tile = np.where(passed < 0, scene.tile_index, passed)[scene.surfaces.token[rows]]
        tint = tile_tints(scene)[tile]
        dims = (tint < CLEAR).any(axis=1)
        if not dims.any():
            return None
        return cls(Rays(scene.surfaces.triangles[rows[dims]]), torch.from_numpy(tint[dims]).to(device))

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


def tile_tints(scene: RenderScene) -> np.ndarray:
    """(T, 3) f32 mean share of light that passes a surface with each tile."""
    means = scene.tiles.mean(axis=(2, 3), dtype=np.float32)
    return (1 - means[:, METALLIC, None]) * means[:, TRANSMISSION, None] * tint_of_glass(means[:, BASE_COLOR])
