# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate the light at the first hits of a view, without any network: `estimate_light` is the way in.

Direct light is in closed form with visibility by rays (direct/), indirect light by radiosity and final gather
(bounce/), what mirrors and glass show by the ends of specular paths (specular/). Light that a few rays estimate is
computed at probes and interpolated.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import torch
from torch import Tensor

from ..compute.inference import current_pieces, like
from ..compute.threads import Once, shared, undivided_operations
from ..light_passes import LOBES
from ..pictures import bands
from ..progress import part
from ..scene import Guides, RenderScene, View
from .bounce.pixels import GlossyPixels, diffuse_bounces, glossy_bounces, light_behind, outgoing_radiance
from .bounce.radiosity import Radiosity
from .direct.direct_light import DirectLight
from .direct.footprints import footprints, roughness_within
from .direct.pixels import add_sheen, direct_light
from .edges import find_edges
from .effort import FULL, Effort
from .hit_surfaces import HitSurfaces, tensors_on
from .probes import SMOOTH, ComputeLight, Filter, Probes, probe_grid
from .separation import Separation
from .specular.paths import blur
from .specular.pixels import (
    REACH,
    SeenLobe,
    in_glass,
    in_mirrors,
    path_end_light,
    reflected_image,
    reflected_light,
    refracted_image,
)
from .surface_light import SurfaceLight
from .vectors import dot

GLOSS_RAYS = 0.25      # share of the rays of a glossy lobe, of what mirrors and glass show
BEYOND = 4.0           # network units from a camera that sees nothing: no medium is farther off
PATHS, BANDS = 0.2, 0.95  # of the work, after what paths meet and before edges
BAND_PIXELS = 1 << 17  # estimated at a time by each thread: tensors of a large picture are gigabytes
BAND_ROWS = 128        # of a band at least, for those beside it are lit too:
MARGIN = 16            # rows, from which a pixel has most of its light
ALIGNED = 8            # a band begins at a multiple of it, so that its probes are those of the picture


@dataclass
class SceneLight:
    """The light of a normalised scene, independent of views."""

    scene: RenderScene
    direct: DirectLight
    radiosity: Radiosity | None  # None: no rays; only direct light is estimated, without shadows


@undivided_operations()
def estimate_light(light: SceneLight, view: View, guides: Guides, effort: Effort = FULL,
                   with_direct: bool = True) -> SurfaceLight:
    """The light of one view (V = 1) on the device of the scene's light, in the radiance units of the scene.

    View and guides are normalised as the scene is. Without `with_direct`, where light was traced, the estimates of the
    same light are 0: the picture shows traced light instead.
    """
    if light.radiosity is None:
        return _unshadowed_light(light, view, guides)
    height, width = guides.alpha.shape
    effort, pictures = effort.of_picture(view.width * view.height), Once()
    paths = _PathLight(light, view, effort, guides.traced is not None, with_direct)
    pixels = current_pieces().limit(max(BAND_PIXELS, BAND_ROWS * width))
    rows = list(zip(*bands(height, width, MARGIN, pixels, ALIGNED), strict=True))

    def path_images(outer: slice, inner: slice) -> list[dict[str, Tensor]]:
        return [{kind: picture[inner] for kind, picture in image.items()}
                for image in paths.images(guides.rows(outer), outer.start)]

    def estimate(outer: slice, inner: slice) -> None:
        of_band = _estimate_band(paths, guides, outer, images)
        picture = pictures.get(lambda: _with_height(of_band, height))
        band = slice(outer.start + inner.start, outer.start + inner.stop)
        for name in SurfaceLight.PICTURES:
            getattr(picture, name)[..., band, :] = getattr(of_band, name)[..., inner, :]

    device = light.direct.device
    with part(0.0, PATHS):
        images = [{kind: torch.cat([image[kind] for image in of_bands]) for kind in of_bands[0]}
                  for of_bands in zip(*shared(path_images, *rows, device=device), strict=True)]
    with part(PATHS, BANDS):
        shared(estimate, *rows, device=device)
    picture = pictures.get(None)
    if effort.edges:
        with part(BANDS, 1.0):
            _antialias(picture, light, view, guides, with_direct)
    return picture


@dataclass
class _PathLight:
    """The light of what specular paths of a view meet."""

    light: SceneLight
    view: View
    effort: Effort
    is_traced: bool
    with_direct: bool

    def surfaces(self, guides: Guides, first_row: int) -> HitSurfaces:
        return HitSurfaces.of(self.light.scene, self.view, guides, first_row, self.light.direct.device)

    def make_probes(self, *picture: Tensor, **options) -> Probes:
        grid = max(probe_grid(self.view.longer_side), self.effort.probe_grid)
        return Probes(*picture, grid=grid, finest=max(grid // self.effort.closer, 1), **options)

    @property
    def filters(self) -> Sequence[Filter]:
        return SMOOTH[:self.effort.smoothings]

    def outgoing(self, group: int | None = None) -> ComputeLight:
        direct = self.light.direct.reaching(group) if self.with_direct else None
        return partial(outgoing_radiance, self.light.radiosity, direct, self.effort)

    def gather(self, seen: HitSurfaces) -> GlossyPixels:
        few = replace(self.effort, probe_rays=GLOSS_RAYS * self.effort.probe_rays)
        probes = self.make_probes(seen.position, seen.normal, seen.is_covered)
        return glossy_bounces(self.light.radiosity, probes, seen, self.filters, few, self.is_traced, self.with_direct)

    def images(self, guides: Guides, first_row: int) -> list[dict[str, Tensor]]:
        """What mirrors, glass and clear coats, if the scene has any, of some rows would show if they were smooth.

        Where there are no coats, theirs is that of mirrors.
        """
        surfaces, direct = self.surfaces(guides, first_row), self.light.direct
        ends = partial(path_end_light, self.make_probes, self.outgoing, self.filters, direct.device)
        reflected = ends("reflected", guides)
        mirrored, *coated = (reflected_image(guides, _as_wide_as_pixels(mirrors), direct, self.gather, reflected)
                             for mirrors in (surfaces, surfaces.coated) if mirrors is not None)
        refracted = refracted_image(guides, surfaces, direct, self.gather, ends, self.with_direct)
        return [mirrored, refracted, *([] if self.light.scene.coat is None else coated or [mirrored])]


def _as_wide_as_pixels(surfaces: HitSurfaces) -> HitSurfaces:
    """Surfaces whose lobes are as wide as all that pixels mirror."""
    return replace(surfaces, roughness=roughness_within(surfaces))


def _estimate_band(paths: _PathLight, guides: Guides, rows: slice, images: list[dict[str, Tensor]]) -> SurfaceLight:
    """The light of some rows of a view, whose guides these are.

    images: as of `_PathLight.images`, of the whole view.
    """
    direct, radiosity, effort = paths.light.direct, paths.light.radiosity, paths.effort
    is_traced, with_direct, filters, outgoing = paths.is_traced, paths.with_direct, paths.filters, paths.outgoing
    around = slice(max(rows.start - REACH, 0), min(rows.stop + REACH, len(guides.alpha)))
    own = slice(rows.start - around.start, rows.stop - around.start)
    around_guides, guides = guides.rows(around), guides.rows(rows)
    around_surfaces = paths.surfaces(around_guides, around.start)
    surfaces = around_surfaces.rows(own)

    def blurred(blur: Callable, image: dict[str, Tensor], surfaces: HitSurfaces) -> dict[str, Tensor]:
        image = {kind: picture[around] for kind, picture in image.items()}
        return {kind: picture[own] for kind, picture in blur(image, around_guides, surfaces).items()}

    with part(0.0, 0.02):
        separation = Separation(*(x.permute(2, 0, 1) for x in (surfaces.position, surfaces.normal)),
                                surfaces.is_covered[..., 0], direct.occluders) if effort.walls else None
    rise = surfaces.rise
    raised = surfaces.position + rise * surfaces.normal
    probes = paths.make_probes(raised, surfaces.normal, surfaces.is_covered, separation=separation)
    with part(0.02, 0.4):
        bounced, sky, fire = diffuse_bounces(radiosity, probes, effort, with_direct)

    def glossy_light(around_surfaces: HitSurfaces, image: dict[str, Tensor]) -> GlossyPixels:
        around_mirrors = _as_wide_as_pixels(around_surfaces)
        mirrors = around_mirrors.rows(own)
        gloss = glossy_bounces(radiosity, probes, mirrors, filters, effort, is_traced, with_direct)
        if with_direct:
            gloss = gloss.with_lamps(SeenLobe.first(around_surfaces.rows(own)).highlights_through_glass(direct))
        light, has_end = reflected_light(blurred(in_mirrors, image, around_mirrors), guides, mirrors, direct,
                                         gloss.highlights)
        return gloss.with_images(light, (1 - blur(mirrors.roughness)[..., None]) * has_end)

    with part(0.4, 0.5):
        gloss, coated, of_coat = glossy_light(around_surfaces, images[0]), surfaces.coated, None
        if coated is not None:
            of_coat = glossy_light(around_surfaces.coated, images[2])
            gloss = gloss.mixed(of_coat, surfaces.coat.share)
    with part(0.5, 0.6):
        passes = surfaces.is_glass
        with_chains = bounced
        if surfaces.translucent is not None:
            is_translucent = surfaces.translucent.any(-1, keepdim=True)
            passes = passes | is_translucent
            through = light_behind(partial(radiosity.behind, effort=effort), probes, rise, filters, is_translucent)
            with_chains, bounced = (torch.lerp(bounced, through[kind], surfaces.translucent)
                                    for kind in ("all", "bounced" if is_traced else "all"))
        behind = light_behind(outgoing(), probes, rise, filters, passes)
    with part(0.6, 0.7):
        refracted = blurred(in_glass, images[1], around_surfaces)
    dark = torch.zeros_like(bounced)
    common = _materials(surfaces) | {"is_traced": dark.new_full((1,), float(is_traced)), "has_rays": dark.new_ones(1)}

    def surface_light(bounced: Tensor, glossy: Tensor, kind: str, **other: Tensor) -> SurfaceLight:
        fields = {"bounced": bounced, "behind": behind[kind] * surfaces.is_glass, "glow": glow, "traced": dark,
                  "reflected": glossy * surfaces.is_toward,
                  "refracted": refracted.get(kind, dark)} | other
        return SurfaceLight(direct=_stack(lobes), **common, **{k: _channels_first(x) for k, x in fields.items()})

    lobes, glow = [dark] * 3, dark
    if with_direct:
        with part(0.7, 1.0):
            lobes = direct_light(direct, probes, surfaces, sky, gloss.sky, refracted.get("direct"), effort,
                                 is_traced)
            if of_coat is not None:
                _, glossy, _ = direct_light(direct, probes, coated, sky, of_coat.sky, None, effort, is_traced)
                lobes[1] = torch.lerp(lobes[1], glossy, surfaces.coat.share)
        if surfaces.translucent is not None:
            lobes[0] = torch.lerp(lobes[0], behind["complete"] - behind["bounced"], surfaces.translucent)
        glow = _glow(direct, surfaces)
        complete = surface_light(with_chains if fire is None else with_chains + fire, gloss.complete, "complete")
        if not is_traced:
            return complete
    beside = surface_light(gloss.remove_missed(bounced, surfaces.diffuse_ratio), gloss.bounced, "bounced",
                           traced=tensors_on(direct.device)(guides.traced).clamp_min(0))
    if not with_direct:
        return beside
    return replace(beside, direct=complete.direct + complete.indirect() - beside.indirect())


def _unshadowed_light(light: SceneLight, view: View, guides: Guides) -> SurfaceLight:
    """Direct light in closed form, past everything that is in its way."""
    direct = light.direct
    surfaces = HitSurfaces.of(light.scene, view, guides, 0, direct.device)
    dark = torch.zeros_like(surfaces.position)
    lobes = [lobe.view_as(dark) * surfaces.is_covered for lobe in _unshadowed_lobes(direct, surfaces)]
    add_sheen(lobes[0], direct, surfaces, torch.ones_like(dark))
    if (coated := surfaces.coated) is not None:
        lobes[1] = torch.lerp(lobes[1], _unshadowed_lobes(direct, coated)[1].view_as(dark), surfaces.coat.share)
    none = dark.new_zeros(1)
    return SurfaceLight(
        **_materials(surfaces), direct=_stack(lobes),
        **dict.fromkeys(SurfaceLight.OF_RAYS, _channels_first(dark)), is_traced=none, has_rays=none)


def _unshadowed_lobes(direct: DirectLight, surfaces: HitSurfaces) -> tuple[Tensor, ...]:
    return direct.lobes(*surfaces.lobe_points, None, footprints(surfaces).flatten(0, 1))


def _materials(surfaces: HitSurfaces) -> dict[str, Tensor]:
    """Albedo and roughness, as SurfaceLight has them."""
    return {"albedo": _stack([surfaces.diffuse, surfaces.glossy, surfaces.transmission]),
            "roughness": surfaces.roughness[None, None]}


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


def _antialias(picture: SurfaceLight, light: SceneLight, view: View, guides: Guides, with_direct: bool) -> None:
    """Mix the light of neighbours into pixels at edges, in place."""
    edges = find_edges(light.scene, view, guides, light.direct.device, light.direct if with_direct else None)
    for name, lobe in (("bounced", "diffuse"), ("behind", "transmission"), ("reflected", "glossy"),
                       ("refracted", "transmission")):
        edges.mix(getattr(picture, name)[0], LOBES.index(lobe))
    if with_direct:
        for lobe, radiance in enumerate(picture.direct[0]):
            edges.mix(radiance, lobe, is_direct=True)


def _with_height(estimate: SurfaceLight, height: int) -> SurfaceLight:
    """Room for the light of a picture of this height, of which there is a band."""
    return SurfaceLight(**{f.name: like(getattr(estimate, f.name), height, -2) if f.name in SurfaceLight.PICTURES
                           else getattr(estimate, f.name) for f in fields(estimate)})


def _channels_first(picture: Tensor) -> Tensor:
    """(h, W, C) -> (1, C, h, W)."""
    return picture.permute(2, 0, 1)[None]


def _stack(lobes: list[Tensor]) -> Tensor:
    """Three (h, W, C) -> (1, 3, C, h, W)."""
    return torch.stack([picture.permute(2, 0, 1) for picture in lobes])[None]
