# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass whose two sides are parallel: light of emitters goes through it straight on."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...geometry import area_vectors, unit
from ...material.reflectance import layer_reflectance
from ...scene import IOR, TRANSMISSION, RenderScene, tile_means, tile_tints
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING, Ray
from ..bounding_sphere import BoundingSphere
from ..cutouts import GAP
from ..fresnel import reflectance
from ..tensor_rays import TensorRays
from ..vectors import dot

SURFACES = 8     # that a ray passes at most
PARALLEL = 0.99  # cosine between normals where a ray enters glass and where it leaves it, at least


class StraightGlass(NamedTuple):
    """All glass of a scene that light of emitters meets, G triangles of its geometry, in order."""

    surfaces: TensorRays
    around: BoundingSphere
    row: Tensor     # (G,) i64, of the geometry
    normal: Tensor  # (G, 3) unit
    tint: Tensor    # (G, 3)
    f0: Tensor      # (G,)

    @classmethod
    def of(cls, scene: RenderScene, device: torch.device | str) -> StraightGlass:
        rays = scene_rays(scene)
        rows = rays.rows(BENDING, Ray.SHADOW)
        corners = scene.surfaces.triangles[rows]
        used, tile = np.unique(scene.tile_index[scene.surfaces.token[rows]], return_inverse=True)
        tiles = scene.tiles[used]
        f0 = layer_reflectance(*tile_means(tiles[:, (IOR, TRANSMISSION)]).T)
        normal, tint, f0 = (torch.from_numpy(np.float32(x)).to(device) for x in (
            unit(area_vectors(corners)), tile_tints(tiles)[tile], f0[tile]))
        return cls(TensorRays(rays.among(BENDING, Ray.SHADOW)), BoundingSphere.of(corners, device),
                   torch.from_numpy(rows.astype(np.int64)).to(device), normal, tint, f0)

    def transmittance(self, origin: Tensor, direction: Tensor, distance: Tensor) -> Tensor:
        """(N, 3) share of light that arrives through glass at points (N, 3) from distances (N,) along unit vectors
        (N, 3): none where it meets no glass, or where that bends it."""
        share, entry = torch.ones_like(direction), torch.zeros_like(direction)
        row, travelled = torch.arange(len(origin), device=origin.device), torch.zeros_like(distance)
        for surface in range(SURFACES):
            hits = self.surfaces.nearest(origin[row] + travelled[:, None] * direction[row], direction[row])
            travelled = travelled + hits.distance
            has_hit = travelled < distance[row]
            if not surface:
                share[~has_hit] = 0
            row, travelled = row[has_hit], travelled[has_hit] + GAP
            if not len(row):
                break
            glass = torch.searchsorted(self.row, hits.triangle[has_hit])
            normal = self.normal[glass]
            cosine = dot(normal, direction[row])
            is_bent = (cosine > 0) & entry[row].any(1) & (dot(entry[row], normal) > -PARALLEL)
            passes = (1 - reflectance(self.f0[glass], cosine.abs())) * ~is_bent
            share[row] *= passes[:, None] * self.tint[glass]
            entry[row] = torch.where(cosine[:, None] < 0, normal, 0)
        return share
