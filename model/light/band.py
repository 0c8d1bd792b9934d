# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of some rows of a view: bounced, glossy, behind surfaces, refracted and direct."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from ..progress import part
from ..scene import Guides
from .bounce.pixels import GlossyPixels, diffuse_bounces, light_behind
from .direct.direct_light import DirectLight
from .direct.pixels import direct_light
from .hit_surfaces import HitSurfaces, tensors_on
from .separation import Separation
from .specular.paths import blur
from .specular.pixels import REACH, SeenLobe, in_glass, in_mirrors, reflected_light
from .surface_light import SurfaceLight
from .vectors import dot
from .view_light import ViewLight, as_wide_as_pixels

BEYOND = 4.0  # network units from a camera that sees nothing: no medium is farther off
Light = dict[str, Tensor]  # (h, W, 3) by kind: all, "complete", or what of it traced light does not contain, "bounced"


class Band:
    """Some rows of a view, and those around them from which mirrors and rough glass show light."""

    def __init__(self, of_view: ViewLight, guides: Guides, rows: slice, images: list[Light]):
        """guides, images: of the whole view, the latter as of `ViewLight.images`."""
        self.view, self.images = of_view, images
        self._around = slice(max(rows.start - REACH, 0), min(rows.stop + REACH, len(guides.alpha)))
        self._own = slice(rows.start - self._around.start, rows.stop - self._around.start)
        self._guides_around, self.guides = guides.rows(self._around), guides.rows(rows)
        self._surfaces_around = of_view.surfaces(self._guides_around, self._around.start)
        self.surfaces = surfaces = self._surfaces_around.crop(self._own)
        separation = None
        if of_view.effort.walls:
            separation = Separation(*(x.permute(2, 0, 1) for x in (surfaces.position, surfaces.normal)),
                                    surfaces.is_covered[..., 0], of_view.light.direct.occluders)
        self.rise = surfaces.rise
        self.probes = of_view.make_probes(surfaces.position + self.rise * surfaces.normal, surfaces.normal,
                                          surfaces.is_covered, separation=separation)

    def light(self) -> SurfaceLight:
        """All that arrives. Where light was traced, the estimate of the same light is `direct` and `glow`."""
        view, surfaces, direct = self.view, self.surfaces, self.view.light.direct
        with part(0.02, 0.4):
            bounced, sky, fire = diffuse_bounces(view.light.radiosity, self.probes, view.effort, view.with_direct)
        with part(0.4, 0.5):
            gloss, of_coat = self._glossy()
        with part(0.5, 0.6):
            diffuse, behind = self._diffuse(bounced), self._behind()
        with part(0.6, 0.7):
            refracted = self._blurred(in_glass, self.images[1], self._surfaces_around)

        def surface_light(kind: str, diffuse: Tensor, glossy: Tensor, direct: list[Tensor] | None = None,
                          **pictures: Tensor) -> SurfaceLight:
            through = {"refracted": refracted[kind]} if kind in refracted else {}
            return SurfaceLight.of_view(
                surfaces, view.is_traced, direct, bounced=diffuse, behind=behind[kind] * surfaces.is_glass,
                reflected=glossy * surfaces.is_toward, **through, **pictures)

        if view.with_direct:
            with part(0.7, 1.0):
                lobes = self._direct(sky, gloss, of_coat, refracted.get("direct"))
            if surfaces.translucent is not None:
                lobes[0] = torch.lerp(lobes[0], behind["complete"] - behind["bounced"], surfaces.translucent)
            white = gloss.to_diffuse(diffuse["complete"], surfaces.diffuse_ratio, is_traced=False)
            white = white if fire is None else white + fire
            complete = surface_light("complete", white, gloss.complete, lobes, glow=_glow(direct, surfaces))
            if not view.is_traced:
                return complete
        white = gloss.to_diffuse(diffuse["bounced"], surfaces.diffuse_ratio, is_traced=True)
        traced = tensors_on(direct.device)(self.guides.traced).clamp_min(0)
        beside = surface_light("bounced", white, gloss.bounced, traced=traced)
        if not view.with_direct:
            return beside
        return replace(beside, direct=complete.direct + complete.indirect() - beside.indirect(), glow=complete.glow)

    def _glossy(self) -> tuple[GlossyPixels, GlossyPixels | None]:
        """What white glossy lobes show but lamps that nothing is before, and the same of clear coats alone."""
        surfaces = self._surfaces_around
        gloss, coated = self._glossy_of(surfaces, self.images[0]), self.surfaces.coated
        if coated is None:
            return gloss, None
        of_coat = self._glossy_of(surfaces.coated, self.images[2])
        return gloss.mixed(of_coat, self.surfaces.coat.share), of_coat

    def _glossy_of(self, surfaces: HitSurfaces, image: Light) -> GlossyPixels:
        """surfaces: of the rows around as well. image: what they would mirror if they were smooth."""
        view, direct = self.view, self.view.light.direct
        mirrors_around = as_wide_as_pixels(surfaces)
        mirrors = mirrors_around.crop(self._own)
        gloss = view.glossy(self.probes, mirrors, view.effort)
        if view.with_direct:
            gloss = gloss.with_lamps(SeenLobe.first(surfaces.crop(self._own)).highlights_through_glass(direct))
        light, has_end = reflected_light(self._blurred(in_mirrors, image, mirrors_around), self.guides, mirrors, direct,
                                         gloss.highlights)
        return gloss.with_images(light, (1 - blur(mirrors.roughness)[..., None]) * has_end)

    def _blurred(self, blur: Callable, image: Light, surfaces: HitSurfaces) -> Light:
        """An image of the whole view as surfaces of these rows and around show it."""
        image = {kind: picture[self._around] for kind, picture in image.items()}
        return {kind: picture[self._own] for kind, picture in blur(image, self._guides_around, surfaces).items()}

    def _diffuse(self, bounced: Tensor) -> Light:
        """Light of white diffuse lobes, some of which are translucent and send on what arrives on the other side."""
        view, share = self.view, self.surfaces.translucent
        if share is None:
            return {"complete": bounced, "bounced": bounced}
        through = light_behind(partial(view.light.radiosity.behind, effort=view.effort), self.probes, self.rise,
                               share.any(-1, keepdim=True))
        return {"complete": torch.lerp(bounced, through["all"], share),
                "bounced": torch.lerp(bounced, through["bounced" if view.is_traced else "all"], share)}

    def _behind(self) -> Light:
        """Light that arrives behind glass and translucent surfaces."""
        passes = self.surfaces.is_glass
        if self.surfaces.translucent is not None:
            passes = passes | self.surfaces.translucent.any(-1, keepdim=True)
        return light_behind(self.view.outgoing(), self.probes, self.rise, passes)

    def _direct(self, sky: Tensor, gloss: GlossyPixels, of_coat: GlossyPixels | None,
                refracted: Tensor | None) -> list[Tensor]:
        """Radiance (h, W, 3) of three white lobes; sky: its visibility, (h, W, 3)."""
        view, surfaces = self.view, self.surfaces

        def lobes(surfaces: HitSurfaces, gloss: GlossyPixels, refracted: Tensor | None) -> list[Tensor]:
            return direct_light(view.light.direct, self.probes, surfaces, sky, gloss.sky, refracted, view.effort)

        shown = lobes(surfaces, gloss, refracted)
        if of_coat is not None:
            shown[1] = torch.lerp(shown[1], lobes(surfaces.coated, of_coat, None)[1], surfaces.coat.share)
        return shown


def _glow(direct: DirectLight, surfaces: HitSurfaces) -> Tensor:
    """(h, W, 3) radiance of the media before the surfaces."""
    if direct.in_scattering is None:
        return torch.zeros_like(surfaces.position)
    has_hit = surfaces.normal.square().sum(-1, keepdim=True) > 0.25
    origin = surfaces.origin.expand_as(surfaces.position)
    # Along the ray: where positions end, far away, they are beside it.
    distance = dot(surfaces.position - origin, surfaces.rays)[..., None]
    end = origin + torch.where(has_hit, distance, BEYOND) * surfaces.rays
    return direct.in_scattering.towards_viewer(origin.flatten(0, 1), end.flatten(0, 1)).view_as(end)
