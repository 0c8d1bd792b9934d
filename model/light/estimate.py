# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate the light at the first hits of a view, without any network: `estimate_light` is the way in.

Direct light is in closed form with visibility by rays (direct/), indirect light by radiosity and final gather
(bounce/), what mirrors and glass show by the ends of specular paths (specular/). Light that a few rays estimate is
computed at probes and interpolated.
"""
from __future__ import annotations

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
from .probes import SMOOTH, ComputeLight, Probes, probe_grid
from .separation import Separation
from .specular.paths import blur
from .specular.pixels import SeenLobe, path_end_light, reflected_light, refracted_light
from .surface_light import SurfaceLight
from .vectors import dot

GLOSS_RAYS = 0.25      # share of the rays of a glossy lobe, of what mirrors and glass show
BEYOND = 4.0           # network units from a camera that sees nothing: no medium is farther off
BANDS = 0.95           # of the work, before edges
BAND_PIXELS = 1 << 17  # estimated at a time by each thread: tensors of a large picture are gigabytes
BAND_ROWS = 8          # bands have a multiple of so many rows, as many of which probes beside them light too


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

    def estimate(outer: slice, inner: slice) -> None:
        of_band = _estimate_band(light, view, guides.rows(outer), outer.start, effort, with_direct)
        picture, band = pictures.get(lambda: _with_height(of_band, height)), slice(
            outer.start + inner.start, outer.start + inner.stop)
        for name in SurfaceLight.PICTURES:
            getattr(picture, name)[..., band, :] = getattr(of_band, name)[..., inner, :]

    with part(0.0, BANDS):
        pixels = current_pieces().limit(BAND_PIXELS)
        shared(estimate, *zip(*bands(height, width, BAND_ROWS, pixels, BAND_ROWS), strict=True),
               device=light.direct.device)
    picture = pictures.get(None)
    if effort.edges:
        with part(BANDS, 1.0):
            _antialias(picture, light, view, guides, with_direct)
    return picture


def _estimate_band(light: SceneLight, view: View, guides: Guides, first_row: int, effort: Effort,
                   with_direct: bool) -> SurfaceLight:
    """The light of some rows of the view, whose guides these are."""
    direct, radiosity, is_traced = light.direct, light.radiosity, guides.traced is not None
    surfaces = HitSurfaces.of(light.scene, view, guides, first_row, direct.device)
    grid, filters = max(probe_grid(view.longer_side), effort.probe_grid), SMOOTH[:effort.smoothings]
    make_probes = partial(Probes, grid=grid, finest=max(grid // effort.closer, 1))
    with part(0.0, 0.02):
        separation = Separation(*(x.permute(2, 0, 1) for x in (surfaces.position, surfaces.normal)),
                                surfaces.is_covered[..., 0], direct.occluders) if effort.walls else None
    rise = surfaces.rise
    raised = surfaces.position + rise * surfaces.normal
    probes = make_probes(raised, surfaces.normal, surfaces.is_covered, separation=separation)

    def outgoing(group: int | None = None) -> ComputeLight:
        return partial(outgoing_radiance, radiosity, direct.reaching(group) if with_direct else None, effort)

    with part(0.02, 0.3):
        bounced, sky, fire = diffuse_bounces(radiosity, probes, effort, with_direct)
    path_ends = partial(path_end_light, make_probes, outgoing, filters, direct.device)
    with part(0.3, 0.4):
        mirrored = path_ends("reflected", guides)

    def gather(seen: HitSurfaces) -> GlossyPixels:
        few = replace(effort, probe_rays=GLOSS_RAYS * effort.probe_rays)
        return glossy_bounces(radiosity, make_probes(seen.position, seen.normal, seen.is_covered), seen, filters, few,
                              is_traced, with_direct)

    def glossy_light(surfaces: HitSurfaces) -> GlossyPixels:
        mirrors = replace(surfaces, roughness=roughness_within(surfaces))
        gloss = glossy_bounces(radiosity, probes, mirrors, filters, effort, is_traced, with_direct)
        if with_direct:
            gloss = gloss.with_lamps(SeenLobe.first(surfaces).highlights_through_glass(direct))
        images, has_end = reflected_light(guides, mirrors, direct, gather, mirrored, gloss.highlights)
        return gloss.with_images(images, (1 - blur(mirrors.roughness)[..., None]) * has_end)

    with part(0.4, 0.5):
        gloss, coated, of_coat = glossy_light(surfaces), surfaces.coated, None
        if coated is not None:
            of_coat = glossy_light(coated)
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
        refracted = refracted_light(guides, surfaces, direct, gather, path_ends, with_direct)
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
