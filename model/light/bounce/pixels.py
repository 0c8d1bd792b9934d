# SPDX-License-Identifier: GPL-3.0-or-later
"""Indirect light at pixels, by probes."""
from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...progress import part
from ..direct.direct_light import SKY_RAYS, DirectLight
from ..effort import Effort
from ..hit_surfaces import HitSurfaces
from ..probes import SMOOTHED, UNSMOOTHED, Around, ComputeLight, Differ, Filter, Probes
from ..specular.paths import BLURRED
from .radiosity import DiffuseLight, GlossyLight, Radiosity

LEAST_RATIO = 1e-3  # diffuse over glossy albedo, below which the diffuse lobe is invisible


def diffuse_bounces(radiosity: Radiosity, probes: Probes, effort: Effort,
                    with_sky: bool) -> tuple[Tensor, Tensor | None, Tensor | None]:
    """(h, W, 3) radiance of a white diffuse lobe, and, `with_sky`, the visibility of the sky and the light of fire.

    Both are (h, W, 3), and None if there is none.
    """
    def compute(x: Tensor, n: Tensor, number: Tensor) -> dict[str, Tensor]:
        light = radiosity.diffuse(x, n, number, effort, with_sky)
        return _named(light if with_sky else light._replace(fire=None))

    filters = Filter(1), Filter(2, _contrast_over_noise), Filter(4, _contrast_over_noise)
    pictures = probes.interpolate(compute, filters=filters[:effort.smoothings])
    return pictures["indirect"], pictures.get("sky"), pictures.get("fire")


@dataclass
class GlossyPixels:
    """GlossyLight of all pixels."""

    complete: Tensor       # (h, W, 3) radiance of a white glossy lobe
    further: Tensor        # (h, W, 3) what the diffuse lobe has besides, as of GlossyLight
    bounced: Tensor | None  # (h, W, 3) what of it traced light does not contain, where light was traced
    missed: Tensor | None  # (h, W, 3) part of that which traced light has instead of light of the diffuse lobe
    sky: Tensor | None     # (h, W, 3) visibility of the sky in the lobe
    highlights: Tensor     # (h, W, 3) what of all is lamps in polished metal

    def with_images(self, images: dict[str, Tensor], sharp: Tensor) -> GlossyPixels:
        """With `images` (h, W, 3) of what is mirrored, "complete" or "bounced", as far as lobes are sharp (h, W, 1)."""
        return replace(self, **{kind: torch.lerp(getattr(self, kind), image, sharp)
                                for kind, image in images.items() if getattr(self, kind) is not None})

    def with_lamps(self, highlights: Tensor) -> GlossyPixels:
        """With the light (h, W, 3) of lamps."""
        return replace(self, complete=self.complete + highlights)

    def mixed(self, other: GlossyPixels, share: Tensor) -> GlossyPixels:
        """With a share (h, W, 3) of the light of another lobe; the visibility of the sky is still that of this one."""
        mixed = {kind: torch.lerp(getattr(self, kind), getattr(other, kind), share)
                 for kind in ("complete", "further", "bounced", "missed") if getattr(self, kind) is not None}
        return replace(self, **mixed)

    def to_diffuse(self, light: Tensor, diffuse_ratio: Tensor, is_traced: bool) -> Tensor:
        """Indirect `light` (h, W, 3) of a white diffuse lobe with what it has besides, and, where light `is_traced`,
        without what that contains of it.

        diffuse_ratio: (h, W), as of HitSurfaces.
        """
        besides = self.further - self.missed if is_traced else self.further
        return (light + besides / diffuse_ratio[..., None].clamp_min(LEAST_RATIO)).clamp_min(0)


def glossy_bounces(radiosity: Radiosity, probes: Probes, surfaces: HitSurfaces, effort: Effort,
                   is_traced: bool, with_sky: bool) -> GlossyPixels:
    """Indirect light of white glossy lobes, smoothed where these are rough."""
    def compute(x: Tensor, n: Tensor, number: Tensor, *gloss: Tensor) -> dict[str, Tensor]:
        return _named(radiosity.glossy(x, n, *gloss, number, effort, is_traced, with_sky))

    probes = probes.for_gloss()
    is_rough = surfaces.roughness[..., None] > BLURRED
    smooth, rough = (probes.interpolate(
        compute, -surfaces.rays, surfaces.roughness, surfaces.f0, surfaces.diffuse_ratio,
        where=surfaces.is_covered & where, filters=used)
        for where, used in ((~is_rough, UNSMOOTHED), (is_rough, SMOOTHED)))
    pictures = {name: smooth[name] + rough[name] for name in smooth}
    bounced = pictures["bounced"] + pictures["missed"] if is_traced else None
    return GlossyPixels(pictures["complete"], pictures["further"], bounced, pictures.get("missed"), pictures.get("sky"),
                        pictures["highlights"])


def light_behind(compute: ComputeLight, probes: Probes, rise: Tensor, where: Tensor) -> dict[str, Tensor]:
    """(h, W, 3) what `compute` gives on the other side of the surfaces that probes are raised above, by (h, W, 1)."""
    def compute_behind(x: Tensor, n: Tensor, number: Tensor, rise: Tensor) -> dict[str, Tensor]:
        return compute(x - 2 * rise * n, -n, number)

    return probes.interpolate(compute_behind, rise, filters=SMOOTHED, where=where)


def outgoing_radiance(radiosity: Radiosity, direct: DirectLight | None, effort: Effort, x: Tensor, n: Tensor,
                      number: Tensor) -> dict[str, Tensor]:
    """(P, 3) radiance leaving white diffuse surfaces at points x (P, 3): "bounced" before, and "complete" if `direct`.
    """
    with part(0.0, 0.5):
        bounced, fire, *_ = radiosity.diffuse(x, n, number, effort, with_sky=False)
    with part(0.5, 1.0):
        if direct is None:
            return {"bounced": bounced}
        arriving = direct.diffuse(x, n, direct.visibility(x, n, sky_rays=effort.of(SKY_RAYS)))
        return {"bounced": bounced, "complete": bounced + (arriving if fire is None else arriving + fire)}


def _contrast_over_noise(light: Tensor, around: Around) -> Differ:
    """Difference of the mean of the first three channels over that which noise, the last channel, explains."""
    grey, variance = light[:, :3].mean(1), around(light[:, -1].square())
    variance = torch.maximum(variance, around(variance))

    def differ(row: Tensor, number: Tensor) -> Tensor:
        noise = (variance[row, None] + variance[number]).sqrt()
        return (grey[row, None] - grey[number]).abs() / noise.clamp_min(1e-9)

    return differ


def _named(light: DiffuseLight | GlossyLight) -> dict[str, Tensor]:
    """What there is of it."""
    return {name: value for name, value in light._asdict().items() if value is not None}
