# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of the surfaces that mirrors and glass show, at pixels."""
from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...material.reflectance import widened
from ...scene import Guides
from ...surface_kinds import Ray
from ..bounce.pixels import GlossyPixels
from ..bounce.polished import SMOOTH
from ..chunks import in_chunks
from ..direct.direct_light import CHUNK, DirectLight
from ..fresnel import lobe_albedo
from ..hit_surfaces import HitSurfaces, tensors_on
from ..probes import SMOOTHED, ComputeLight, Probes
from ..sampling import r2_starts
from ..vectors import dot, unit
from .frosted import frosted
from .glossy_image import blurred_image
from .paths import BLURRED

REACH = 64          # rows from which pixels of mirrors and glass that are not quite smooth show light
LEAST_SHARE = 1e-3  # of a lobe, that meets surfaces, from which on their image is all that it shows
RAYS = 4           # to each emitter from a mirrored point
FINE = 0.03, 0.08  # roughness up to which one path finds the highlights in a mirror, and from which rays of the lobe do
# Lobes of what paths meet, as of Guides
MIRRORED = "mirrored", "layer", "reflected_gloss"
LEAVING, BEHIND = ("exit", "inner"), "refracted_gloss"
Gather = Callable[[HitSurfaces], GlossyPixels]  # what white glossy lobes of surfaces show
PathEndLight = Callable[[str, Guides], tuple[dict[str, Tensor], Tensor]]  # `path_end_light`, of a lobe


def reflected_image(guides: Guides, surfaces: HitSurfaces, direct: DirectLight, gather: Gather,
                    ends: tuple[dict[str, Tensor], Tensor]) -> dict[str, Tensor]:
    """What smooth mirrors would show, (h, W, 3) "bounced" or "complete", and (h, W, 1) "share", where surfaces.

    ends: light at the ends of reflected paths, as `path_end_light` gives it. Empty where no paths were followed.
    """
    light, has_end = dict(ends[0]), ends[1]
    if not light:
        return light
    if "complete" in light and guides.reflected_light is not None:
        light["complete"] = light["complete"] + tensors_on(has_end.device)(guides.reflected_light)
    for lobe in _seen_lobes(guides, surfaces, MIRRORED).values():
        lobe.add_gloss(light, direct, gather)
    return light | {"share": has_end.float()}


def reflected_light(image: dict[str, Tensor], guides: Guides, surfaces: HitSurfaces, direct: DirectLight,
                    highlights: Tensor) -> tuple[dict[str, Tensor], Tensor]:
    """What mirrors show, (h, W, 3) "bounced" or "complete", and (h, W, 1) bool where they show surfaces.

    image: `reflected_image`, blurred. highlights: (h, W, 3) radiance of lamps in the metal that is seen around the
    lobe, by many rays.
    """
    light = dict(image)
    if not light:
        return light, torch.zeros_like(surfaces.is_covered)
    share = light.pop("share")
    if "complete" in light and guides.reflected_light is not None:
        mean = ((surfaces.roughness[..., None] - FINE[0]) / (FINE[1] - FINE[0])).clamp(0, 1)
        if guides.mirrored_roughness is not None:
            mean = mean * (tensors_on(direct.device)(guides.mirrored_roughness) < SMOOTH)
        lamps = {name: lobe.lamps(direct) for name, lobe in _seen_lobes(guides, surfaces, MIRRORED).items()}
        of_metal = lamps.pop("mirrored", torch.zeros_like(highlights))
        light["complete"] = light["complete"] + torch.lerp(of_metal, highlights, mean) + sum(lamps.values())
    return light, share > LEAST_SHARE


def refracted_image(guides: Guides, surfaces: HitSurfaces, direct: DirectLight, gather: Gather,
                    path_ends: PathEndLight, with_direct: bool) -> dict[str, Tensor]:
    """What smooth glass would show, (h, W, 3) from surfaces, "bounced" or "complete", and `with_direct` from lamps and
    the sky, "direct". Empty where no paths were followed."""
    light, _ = path_ends("refracted", guides)
    behind = _seen_lobes(guides, surfaces, [BEHIND]).get(BEHIND)
    if behind is not None:
        behind.add_gloss(light, direct, gather)
    if with_direct and guides.refracted_light is not None:
        light["direct"] = tensors_on(direct.device)(guides.refracted_light) + sum(
            lobe.lamps(direct) for lobe in _seen_lobes(guides, surfaces, (*LEAVING, BEHIND)).values())
    return light


def in_mirrors(image: dict[str, Tensor], guides: Guides, surfaces: HitSurfaces) -> dict[str, Tensor]:
    """`reflected_image` as surfaces that are not quite smooth show it; of pixels up to REACH rows off."""
    if not image:
        return image
    end = tensors_on(surfaces.position.device)(guides.reflected_position)
    return _at_once(lambda light: blurred_image(light, end, image["share"] > 0, surfaces), image)


def in_glass(image: dict[str, Tensor], guides: Guides, surfaces: HitSurfaces) -> dict[str, Tensor]:
    """`refracted_image` as rough glass shows it; of pixels up to REACH rows off."""
    if not image:
        return image
    end, color = map(tensors_on(surfaces.position.device), (guides.refracted_position, guides.refracted_color))
    return _at_once(lambda light: frosted(light, surfaces, end, color.any(-1)), image)


def _at_once(blur: Callable[[Tensor], Tensor], image: dict[str, Tensor]) -> dict[str, Tensor]:
    """All pictures (h, W, C), which are blurred by the same weights."""
    sizes = [picture.shape[-1] for picture in image.values()]
    return dict(zip(image, blur(torch.cat(list(image.values()), -1)).split(sizes, -1), strict=True))


def path_end_light(make_probes: Callable[..., Probes], outgoing: Callable[[int | None], ComputeLight],
                   device: torch.device, lobe: str, guides: Guides) -> tuple[dict[str, Tensor], Tensor]:
    """(h, W, 3) radiance from the surfaces at which specular paths end, tinted, and (h, W, 1) bool where they meet any.

    lobe: "reflected" or "refracted". outgoing(group): of positions, normals and numbers, the radiance (P, 3) of white
    diffuse surfaces of a group, of several kinds. Empty where no paths were followed.
    """
    to_tensor = tensors_on(device)
    arrays = [getattr(guides, f"{lobe}_{kind}") for kind in ("position", "normal", "color")]
    if arrays[0] is None:
        return {}, to_tensor(np.zeros_like(guides.alpha))[..., None] > 0
    position, normal, color = map(to_tensor, arrays)
    is_lit = color.amax(-1, keepdim=True) > 0
    probes = make_probes(position, unit(normal), is_lit)
    groups = getattr(guides, f"{lobe}_group")
    if groups is None:
        lights = [probes.interpolate(outgoing(None), filters=SMOOTHED)]
    else:
        lights = [probes.interpolate(outgoing(number), where=is_lit & (to_tensor(groups) == number), filters=SMOOTHED)
                  for number in np.unique(groups).astype(int).tolist()]
    light = {kind: sum(some[kind] for some in lights) * color for kind in lights[0]}
    return light, (normal != 0).any(-1, keepdim=True)


class SeenLobe(NamedTuple):
    """A lobe of what paths meet, as if that were seen itself."""

    surfaces: HitSurfaces
    share: Tensor      # (h, W, 3) of its light that is seen
    roughness: Tensor  # (h, W, 1) of its own: where it is mirrored, that of `surfaces` is as much wider as the mirror's

    @classmethod
    def first(cls, surfaces: HitSurfaces) -> SeenLobe:
        """The white glossy lobe of the first surfaces."""
        return cls(surfaces, torch.ones_like(surfaces.position), surfaces.roughness[..., None])

    def among(self, chosen: Tensor) -> SeenLobe:
        """At some pixels (h, W, 1) alone."""
        return self._replace(surfaces=replace(self.surfaces, coverage=self.surfaces.coverage * chosen))

    def lamps(self, direct: DirectLight) -> Tensor:
        """(h, W, 3) radiance of the lamps in it."""
        return self.highlights(direct) + self.highlights_through_glass(direct)

    def highlights(self, direct: DirectLight) -> Tensor:
        """(h, W, 3) the same of those that no glass is before."""
        seen, highlights = self.surfaces, torch.zeros_like(self.share)
        if not len(direct.emitters):
            return highlights
        at = seen.is_covered[..., 0].nonzero().unbind(1)
        start = r2_starts(torch.arange(RAYS * len(at[0]), device=direct.device)).view(-1, RAYS, 2)
        return highlights.index_put(at, self.share[at] * direct.highlights(
            seen.position[at], seen.normal[at], start, -seen.rays[at], seen.roughness[at], seen.f0[at]))

    def highlights_through_glass(self, direct: DirectLight) -> Tensor:
        """The same of those whose light goes straight through glass."""
        if not direct.has_glass:
            return torch.zeros_like(self.share)
        # Cycles blurs glass (Filter Glossy 1) behind lobes whose density, here that in the middle, is below 1.
        density = 1 / (4 * math.pi * self.roughness.clamp_min(0.1) ** 4)
        straight, position = direct.through_glass, self.surfaces.position
        is_lit = straight.may_pass_glass(position.flatten(0, 1)).view_as(density)
        return density.clamp(max=1).square() * self.among(is_lit).highlights(straight)

    def add_gloss(self, light: dict[str, Tensor], direct: DirectLight, gather: Gather) -> None:
        """Add to (h, W, 3) "bounced" or "complete", in place, what it mirrors but lamps: surfaces and the sky.

        Polished metal does not, at which paths go on.
        """
        seen, share = self.among((self.surfaces.f0[..., None] < 1) | (self.roughness >= BLURRED)).surfaces, self.share
        at = seen.is_covered[..., 0].nonzero().unbind(1)
        if not len(at[0]):
            return
        gloss, sky = gather(seen), direct.sky_seen_by(Ray.GLOSSY)
        if "complete" in light and sky is not None:
            radiance = in_chunks(CHUNK, sky.reflected, seen.normal[at], -seen.rays[at], seen.roughness[at], seen.f0[at])
            light["complete"] = light["complete"].index_put(at, share[at] * gloss.sky[at] * radiance, accumulate=True)
        for kind in light:
            if (radiance := getattr(gloss, kind)) is not None:
                light[kind] = light[kind] + share * radiance


def _seen_lobes(guides: Guides, surfaces: HitSurfaces, names: Iterable[str]) -> dict[str, SeenLobe]:
    """Those that what is met by paths from `surfaces` has."""
    return {name: _seen_lobe(guides, surfaces, name) for name in names if getattr(guides, f"{name}_color") is not None}


def _seen_lobe(guides: Guides, surfaces: HitSurfaces, name: str) -> SeenLobe:
    to_tensor = tensors_on(surfaces.position.device)
    position, normal, color, own, f0, viewer = (
        None if values is None else to_tensor(values) for values in (
            getattr(guides, f"{name}_{kind}", None) for kind in ("position", "normal", "color", "roughness", "f0",
                                                                 "viewer")))
    n, roughness = unit(normal), own[..., 0]
    if name in MIRRORED:
        roughness = widened(roughness, surfaces.roughness ** 4)
    if viewer is None:
        viewer = surfaces.position - position if name in MIRRORED else n
    viewer = unit(viewer)
    if f0 is None:
        f0 = torch.ones_like(roughness)
    else:
        f0 = f0[..., 0]
        albedo = lobe_albedo(f0.flatten(), dot(n, viewer).flatten(), roughness.flatten()).view_as(f0)
        color = color * torch.where(f0 < 1, albedo, 1)[..., None]
    return SeenLobe(replace(surfaces, position=position, normal=n, rays=-viewer, roughness=roughness, f0=f0,
                            coverage=(color.amax(-1, keepdim=True) > 0).float(), diffuse_ratio=torch.zeros_like(f0)),
                    color, own)
