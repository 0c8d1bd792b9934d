# SPDX-License-Identifier: GPL-3.0-or-later
"""Polished metal as rays along glossy lobes meet it: it shows lamps, and what a mirror in its place would show.

Patches send light to all sides, or around one direction. That is right for matte surfaces, and for polished ones only
where they are met by light that is blurred anyway, that of diffuse lobes.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...material.reflectance import widened
from ...scene import BASE_COLOR, METALLIC, ROUGHNESS, RenderScene, tile_means
from ...shading import surface
from ...surface_kinds import Ray
from ..direct.direct_light import DirectLight
from ..direct.environment_light import LIFT
from ..sampling import hashed_starts
from ..specular.glass import PURE
from ..tensor_rays import TensorHits, TensorRays
from ..vectors import dot

SMOOTH = 0.5  # roughness up to which metal is polished


class Mirrored(NamedTuple):
    """What M of N rays that meet polished metal find there."""

    row: Tensor        # (M,) of the ray
    color: Tensor      # (M, 3) of the metal
    direction: Tensor  # (M, 3) in which the ray goes on, unit
    hits: TensorHits   # of M rays, what it meets then
    lamps: Tensor      # (M, 3) radiance of the highlights of lamps
    sky: Tensor        # (M, 3) radiance of the sky, where the ray meets nothing more

    def behind(self, hits: TensorHits, direction: Tensor) -> tuple[TensorHits, Tensor]:
        """What N rays meet at last, and the unit vectors (N, 3) along which, of what they meet first."""
        after = [value.index_put((self.row,), onward) for value, onward in zip(hits, self.hits, strict=True)]
        return TensorHits(*after), direction.index_put((self.row,), self.direction)


class PolishedMetal:
    """All polished metal of a normalised scene."""

    def __init__(self, scene: RenderScene, surfaces: TensorRays, direct: DirectLight, is_polished: np.ndarray):
        """surfaces: that rays meet; is_polished: (N,) bool of tokens."""
        self._scene, self._surfaces, self._direct = scene, surfaces, direct
        self._is_polished = torch.from_numpy(np.append(is_polished[scene.surfaces.token], False)).to(direct.device)

    @classmethod
    def of(cls, scene: RenderScene, surfaces: TensorRays, direct: DirectLight) -> PolishedMetal | None:
        """None where there is none."""
        metallic, roughness = tile_means(scene.tiles[:, (METALLIC, ROUGHNESS)]).T
        is_polished = ((metallic > PURE) & (roughness < SMOOTH))[scene.tile_index] & ~scene.is_light
        return cls(scene, surfaces, direct, is_polished) if is_polished.any() else None

    def mirror(self, origin: Tensor, direction: Tensor, hits: TensorHits, alpha2: Tensor) -> Mirrored:
        """From points (N, 3) along unit vectors (N, 3) to their hits. alpha2: (N,), squared GGX alpha of a lobe as
        wide as what each ray stands for."""
        row = self._is_polished[hits.triangle].nonzero()[:, 0]  # waits for a GPU
        origin, direction, distance = origin[row], direction[row], hits.distance[row]
        point = origin + distance[:, None] * direction
        normal, texel = self._surface(hits.triangle[row], point, direction)
        color, roughness = texel[:, BASE_COLOR], texel[:, ROUGHNESS]
        onward = direction - 2 * dot(direction, normal)[:, None] * normal
        begin = point + LIFT * normal
        found = self._surfaces.nearest(begin, onward)
        sky = torch.zeros_like(color)
        if (environment := self._direct.sky_seen_by(Ray.GLOSSY)) is not None:
            sky = environment.filtered(onward, roughness) * found.distance.isinf()[:, None]
        lamps = self._highlights(begin, normal, -direction, widened(roughness, alpha2[row]))
        return Mirrored(row, color, onward, found, color * lamps, color * sky)

    def _surface(self, triangle: Tensor, point: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
        """Unit normals (M, 3) facing the rays, and material texels (M, C)."""
        normal, _, texel = surface(self._scene, *(x.cpu().numpy() for x in (triangle, point, direction)))
        return torch.from_numpy(normal).to(point), torch.from_numpy(texel).to(point)

    def _highlights(self, x: Tensor, n: Tensor, *view: Tensor) -> Tensor:
        """(M, 3) radiance of lamps that white metal sends towards the viewer; view: of unit vectors (M, 3), roughness
        (M,)."""
        start = hashed_starts(x, 2)[:, None]
        return self._direct.highlights(x, n, start, *view, torch.ones_like(n[:, 0]))
