# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that let light pass straight, such as coloured panes without refraction, and what they take from it."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..rays import Rays
from ..scene import RenderScene
from ..scene_rays import scene_rays
from ..surface_kinds import STRAIGHT_THROUGH, Ray, clear_tiles, is_kind
from .sampling import hashed_starts
from .tensor_rays import TensorHits, TensorRays

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
        tint = clear_tiles(scene)[tile]
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


class Veils:
    """The same surfaces where rays look for what they meet: as much of it as is not clear, by chance."""

    def __init__(self, clear: Tensor, token: Tensor):
        """clear: (N + 1, 3) share of each colour that passes token triangles straight; token: (G + 1,), of geometry."""
        self._share = clear.mean(1)
        self._tint, self._token = clear / self._share[:, None].clamp_min(1e-9), token

    @classmethod
    def of(cls, scene: RenderScene, device: torch.device | str) -> Veils | None:
        """None where there are none."""
        token, kinds = scene.surfaces.token, scene_rays(scene).trees.kinds
        # Rays may be shared with a scene to which lamps have been appended, which no ray meets.
        veils = np.unique(token[:len(kinds)][is_kind(kinds, STRAIGHT_THROUGH)])
        if not len(veils):
            return None
        clear = np.zeros((len(scene) + 1, 3), np.float32)
        clear[veils] = clear_tiles(scene)[scene.tile_index[veils]]
        return cls(*(torch.from_numpy(x).to(device) for x in (clear, np.append(token, -1))))

    def pass_some(self, surfaces: TensorRays, origin: Tensor, direction: Tensor,
                  hits: TensorHits) -> tuple[TensorHits, Tensor]:
        """What rays (N, 3) that have found `hits` find behind those that they pass, and the colour (N, 3) of these."""
        triangle, distance, weights = (x.clone() for x in hits)
        tint, row = torch.ones_like(direction), torch.arange(len(origin), device=origin.device)
        for _ in range(LAYERS):
            token = self._token[triangle[row]]
            point = origin[row] + torch.where(triangle[row] < 0, 0, distance[row])[:, None] * direction[row]
            passes = (hashed_starts(point, 1)[:, 0] < self._share[token]).nonzero()[:, 0]  # waits for a GPU
            if not len(passes):
                break
            row, token = row[passes], token[passes]
            tint[row] *= self._tint[token]
            travelled = distance[row] + GAP
            behind = surfaces.nearest(origin[row] + travelled[:, None] * direction[row], direction[row])
            triangle[row], distance[row], weights[row] = behind.triangle, behind.distance + travelled, behind.weights
        return TensorHits(triangle, distance, weights), tint
