# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of the surfaces that mirrors and glass show, at pixels."""
from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import torch
from torch import Tensor

from ...scene import Guides
from ..direct.direct_light import DirectLight
from ..fresnel import lobe_albedo
from ..hit_surfaces import HitSurfaces, tensors_on
from ..probes import Filter, Probes
from ..sampling import r2_starts
from ..vectors import dot, unit
from .frosted import frosted
from .glossy_image import blurred_image

LEAST_SHARE = 1e-3  # of a lobe, that meets surfaces, from which on their image is all that it shows
RAYS = 4           # to each emitter from a mirrored point
FINE = 0.03, 0.08  # roughness up to which one path finds the highlights in a mirror, and from which rays of the lobe do
PathEndLight = Callable[[str, Guides], tuple[dict[str, Tensor], Tensor]]  # `path_end_light`, of a lobe


def reflected_light(guides: Guides, surfaces: HitSurfaces, direct: DirectLight, ends: tuple[dict[str, Tensor], Tensor],
                    highlights: Tensor) -> tuple[dict[str, Tensor], Tensor]:
    """What mirrors show, (h, W, 3) "bounced" or "complete", and (h, W, 1) bool where they show surfaces.

    ends: light at the ends of reflected paths, as `path_end_light` gives it. highlights: (h, W, 3) radiance of lamps in
    the metal that is seen around the lobe, by many rays. Empty where no paths were followed.
    """
    light, has_end = dict(ends[0]), ends[1]
    if not light:
        return light, has_end
    to_tensor, has_light = tensors_on(has_end.device), "complete" in light and guides.reflected_light is not None
    if has_light:
        light["complete"] = light["complete"] + to_tensor(guides.reflected_light)
    image = torch.cat([*light.values(), has_end.float()], -1)
    *images, share = blurred_image(image, to_tensor(guides.reflected_position), has_end, surfaces).split(
        [3] * len(light) + [1], -1)
    light = dict(zip(light, images, strict=True))
    if has_light:
        mean = ((surfaces.roughness[..., None] - FINE[0]) / (FINE[1] - FINE[0])).clamp(0, 1)
        light["complete"] = (light["complete"]
                             + torch.lerp(mirrored_highlights(guides, surfaces, direct, "mirrored"), highlights, mean)
                             + mirrored_highlights(guides, surfaces, direct, "layer"))
    return light, share > LEAST_SHARE


def refracted_light(guides: Guides, surfaces: HitSurfaces, direct: DirectLight, path_ends: PathEndLight,
                    with_direct: bool) -> dict[str, Tensor]:
    """What glass shows, (h, W, 3) from surfaces, "bounced" or "complete", and `with_direct` from lamps and the sky,
    "direct"; blurred where it is rough. Empty where no paths were followed."""
    light, _ = path_ends("refracted", guides)
    if with_direct and guides.refracted_light is not None:
        light["direct"] = tensors_on(direct.device)(guides.refracted_light) + exit_highlights(guides, direct)
    if not light:
        return light
    blurred = frosted(torch.cat(list(light.values()), -1), surfaces)  # all at once, which have the same weights
    return dict(zip(light, blurred.split(3, -1), strict=True))


def path_end_light(make_probes: Callable[..., Probes], outgoing: Callable[..., dict[str, Tensor]],
                   filters: Iterable[Filter], device: torch.device, lobe: str,
                   guides: Guides) -> tuple[dict[str, Tensor], Tensor]:
    """(h, W, 3) radiance from the surfaces at which specular paths end, tinted, and (h, W, 1) bool where they meet any.

    lobe: "reflected" or "refracted". outgoing(position, normal, number): (P, 3) radiance of white diffuse surfaces, of
    several kinds. Empty where no paths were followed.
    """
    to_tensor = tensors_on(device)
    arrays = [getattr(guides, f"{lobe}_{kind}") for kind in ("position", "normal", "color")]
    if arrays[0] is None:
        return {}, to_tensor(np.zeros_like(guides.alpha))[..., None] > 0
    position, normal, color = map(to_tensor, arrays)
    is_lit = color.amax(-1, keepdim=True) > 0
    probes = make_probes(position, unit(normal), is_lit)
    light = probes.interpolate(outgoing, filters=filters)
    return {kind: radiance * color for kind, radiance in light.items()}, (normal != 0).any(-1, keepdim=True)


def mirrored_highlights(guides: Guides, surfaces: HitSurfaces, direct: DirectLight, lobe: str) -> Tensor:
    """(h, W, 3) radiance of the lamps that are mirrored by what reflections meet first, its metal ("mirrored") or its
    dielectric "layer".

    The lobe of that is as much wider as the surface's own is.
    """
    def widened(at: tuple[Tensor, Tensor], x: Tensor, n: Tensor, roughness: Tensor) -> tuple[Tensor, Tensor]:
        return unit(surfaces.position[at] - x), (roughness ** 4 + surfaces.roughness[at] ** 4) ** 0.25

    return _highlights(guides, lobe, direct, widened)


def exit_highlights(guides: Guides, direct: DirectLight) -> Tensor:
    """(h, W, 3) radiance of the lamps that are seen through the rough glass that refractions leave first, and of those
    that all glass mirrors inside."""
    return sum(_highlights(guides, lobe, direct, lambda at, x, n, roughness: (n, roughness))
               for lobe in ("exit", "inner"))


def _highlights(guides: Guides, lobe: str, direct: DirectLight,
                gloss_at: Callable[..., tuple[Tensor, Tensor]]) -> Tensor:
    """gloss_at(pixels, position, normal, roughness): (P, 3) unit vectors to the viewer, and roughness (P,)."""
    to_tensor = tensors_on(direct.device)
    highlights = torch.zeros(*guides.alpha.shape, 3, device=direct.device)
    if getattr(guides, f"{lobe}_color") is None or not len(direct.emitters):
        return highlights
    position, normal, color, roughness = (
        to_tensor(getattr(guides, f"{lobe}_{kind}")) for kind in ("position", "normal", "color", "roughness"))
    at = (color.amax(-1) > 0).nonzero().unbind(1)
    x, n = position[at], unit(normal[at])
    viewer, width = gloss_at(at, x, n, roughness[at][:, 0])
    f0, share = torch.ones_like(width), color[at]
    if lobe == "layer":
        f0 = to_tensor(guides.layer_f0)[at][:, 0]
        share = share * lobe_albedo(f0, dot(n, viewer), width)[:, None]
    start = r2_starts(torch.arange(RAYS * len(x), device=x.device)).view(-1, RAYS, 2)
    return highlights.index_put(at, direct.highlights(x, n, start, viewer, width, f0) * share)
