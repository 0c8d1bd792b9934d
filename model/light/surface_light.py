# SPDX-License-Identifier: GPL-3.0-or-later
"""The light at the first hits of views, and the picture that it makes."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from torch import Tensor

from ..fields import COLOR, RADIANCE, array
from ..tensor_group import TensorGroup
from .hit_surfaces import HitSurfaces

BEHIND = 0.6  # share of the light from all over behind glass that it shows at roughness 1


@dataclass
class SurfaceLight(TensorGroup):
    """V views of H x W pixels, f32: radiance that white lobes would send to the viewer, and their albedos.

    The three lobes of `albedo` and `direct` are LOBES: diffuse, glossy, transmission. Where light was traced, that
    stands for all direct light, and for what mirrors and glass show of it, and is weighted by albedos and coverage
    already; `direct` and `glow` then estimate the same light, are no part of the picture, and may be 0.
    """

    OF_RAYS: ClassVar = "bounced", "behind", "reflected", "refracted", "glow", "traced"
    PICTURES: ClassVar = ("albedo", "roughness", "direct", *OF_RAYS)

    albedo: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2})  # [lobe, rgb], premultiplied by coverage
    roughness: Tensor = array("V", 1, "H", "W")                      # perceptual
    direct: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2, RADIANCE: 2})  # from emitters and the environment
    bounced: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1, RADIANCE: 1})    # indirect light, of a diffuse lobe
    behind: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1, RADIANCE: 1})     # the same of the surface's back
    reflected: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1, RADIANCE: 1})  # indirect light in mirrors and gloss
    refracted: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1, RADIANCE: 1})  # indirect light behind smooth glass
    glow: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1, RADIANCE: 1})  # radiance of media before the surface
    traced: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1, RADIANCE: 1})     # traced light; 0 without it
    is_traced: Tensor = array("V")                                                # 1 if light was traced, else 0
    has_rays: Tensor = array("V")  # 1 if estimates are by rays; else `direct` has no shadows, and all else is 0

    @classmethod
    def of_view(cls, surfaces: HitSurfaces, is_traced: bool, direct: list[Tensor] | None, has_rays: bool = True,
                **pictures: Tensor) -> SurfaceLight:
        """The light of one view: `direct` (h, W, 3) by lobe, and `pictures` (h, W, 3) of OF_RAYS; 0 where not given."""
        dark = torch.zeros_like(surfaces.position)
        if surfaces.matte_share is not None:
            direct = direct and [direct[0] * surfaces.matte_share, *direct[1:]]
            pictures["bounced"] = pictures.get("bounced", dark) * surfaces.matte_share
        lobes = surfaces.diffuse, surfaces.glossy, surfaces.transmission
        albedo, direct = (torch.stack([lobe.permute(2, 0, 1) for lobe in of_lobes])[None]
                          for of_lobes in (lobes, direct or [dark] * 3))
        return cls(albedo, surfaces.roughness[None, None], direct,
                   *(pictures.get(name, dark).permute(2, 0, 1)[None] for name in cls.OF_RAYS),
                   is_traced=dark.new_full((1,), float(is_traced)), has_rays=dark.new_full((1,), float(has_rays)))

    def indirect(self) -> Tensor:
        """(V, 3, 3, H, W) indirect light of each lobe. Rough glass also shows light from all over behind it."""
        transmitted = self.refracted + BEHIND * self.roughness.square() * self.behind
        return torch.stack([self.bounced, self.reflected, transmitted], dim=1)

    def bounces(self) -> Tensor:
        """(V, 3, H, W) indirect light of all lobes."""
        return (self.indirect() * self.albedo).sum(1)

    def estimate(self) -> Tensor:
        """(V, 3, H, W) of the light that may have been traced, by estimates alone."""
        return (self.direct * self.albedo).sum(1) + self.glow

    def radiance(self) -> Tensor:
        """(V, 3, H, W) of the picture, without emitters and environment that the camera sees directly."""
        is_traced = self.is_traced.view(-1, 1, 1, 1)
        return is_traced * self.traced + (1 - is_traced) * self.estimate() + self.bounces()

    def is_by_rays(self) -> bool:
        """Whether the estimates of all views are by rays."""
        return bool((self.has_rays > 0).all())

    def rows(self, rows: slice) -> SurfaceLight:
        """Some rows of the views; shared memory."""
        return replace(self, **{name: getattr(self, name)[..., rows, :] for name in self.PICTURES})
