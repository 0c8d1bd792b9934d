# SPDX-License-Identifier: GPL-3.0-or-later
"""What a surface does to the specular paths that meet it: mirror, bend or pass them on, or end them and show itself."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...first_hits.from_rays import colors_of_texels
from ...first_hits.seen_colors import layer_share
from ...first_hits.sheets import own_texels
from ...geometry import dot, reflected, refracted
from ...material.reflectance import layer_reflectance
from ...scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene
from ...shading import bent_to_reflect, emission_share, side_normals
from ...surface_kinds import Ray
from .facets import rough_facets
from .glass import PURE, Cast, is_glass, lost, passed_plates, tint_of_surface
from .path_lobes import LIFT, MetSurfaces, exit_lobe, gloss_lobe, inner_lobe, layer_lobe, metal_lobe
from .paths import BLURRED, SURFACES, Hits, PathEnds, Paths, Sheets

NEARLY = 0.75      # chance of paths to pass a sheet from which on all do, and none with as much of the opposite


def scattered(scene: RenderScene, cast: Cast, paths: Paths, hits: Hits, sheets: Sheets | None, number: int,
              ends: PathEnds) -> Paths:
    """The paths that go on from the surfaces that they meet, those of that number; `ends` becomes what they show here.

    cast: of everything; sheets: as of `follow_paths`.
    """
    point = paths.origin + hits.distance[:, None] * paths.direction
    met = MetSurfaces.at(scene, hits.triangle, point, paths.direction, paths.tint)
    paths.reach = np.maximum(paths.reach, hits.distance)
    if scene.glow is not None:
        glow = scene.glow[scene.surfaces.token[met.triangle]] * emission_share(scene, met.triangle, point)
        ends.light[paths.row] += paths.tint * glow * ~paths.is_straight[:, None]
    scattering = Scattering.of(met, hits.is_dark)
    if sheets is not None:
        scattering.pass_sheets(sheets, scene, met, paths, number)
    direction = scattering.turn(scene, met, paths, number)
    paths.shows_lamps = np.ones(len(point), bool)
    if number == 0:
        _set_first_lobes(ends, scene, cast, met, scattering, paths)
    if number > 0 or paths.start is not None:
        _set_gloss(ends, met, scattering, paths)
    _set_diffuse(ends, met, scattering, paths.row, number == SURFACES - 1)
    lift = LIFT * paths.reach[:, None]
    paths.origin, paths.before, paths.direction = point + lift * direction, point - lift * met.direction, direction
    paths.tint, paths.entry = scattering.tint, np.where((scattering.bends & ~met.inside)[:, None], met.normal, 0)
    paths.ray = np.where(scattering.bends, np.uint8(Ray.TRANSMISSION), np.uint8(Ray.GLOSSY))
    return paths.among(scattering.goes_on)


@dataclass
class Scattering:
    """How S paths leave the surfaces that they meet."""

    bends: np.ndarray     # (S,) bool, refracted, by glass
    leaves: np.ndarray    # (S,) bool, the same from its inside
    mirrors: np.ndarray   # (S,) bool, reflected by metal
    is_image: np.ndarray  # (S,) bool, by metal so smooth that it shows an image
    passes: np.ndarray    # (S,) bool, straight through a sheet
    on_sheet: np.ndarray  # (S,) bool, through a sheet or not
    is_lost: np.ndarray   # (S,) bool, not at all, at glass
    is_dark: np.ndarray   # (S,) bool, as of Hits
    matte: np.ndarray     # (S,) share of the diffuse lobe in what the surface sends on, without its dielectric layer
    tint: np.ndarray      # (S, 3) share of what the paths meet next that is seen

    @classmethod
    def of(cls, met: MetSurfaces, is_dark: np.ndarray) -> Scattering:
        """Where no surface is a sheet, and no path is lost."""
        texel, never = met.texel, np.zeros(len(met.texel), bool)
        bends, mirrors = is_glass(texel, met.inside), texel[:, METALLIC] > PURE
        tint = met.tint * np.where(bends[:, None], tint_of_surface(texel, met.inside), texel[:, BASE_COLOR])
        return cls(bends, bends & met.inside, mirrors, mirrors & (texel[:, ROUGHNESS] < BLURRED), never, never, never,
                   is_dark, (1 - texel[:, METALLIC]) * (1 - texel[:, TRANSMISSION]), tint)

    @property
    def goes_on(self) -> np.ndarray:
        """(S,) bool: whether paths meet anything else."""
        return (self.bends | self.passes | self.is_image) & ~self.is_lost & ~self.is_dark

    def pass_sheets(self, sheets: Sheets, scene: RenderScene, met: MetSurfaces, paths: Paths, number: int) -> None:
        """Of the paths that meet sheets, as their surfaces of that number, some go straight on, and others end."""
        clear = sheets.clear[scene.tile_index[scene.surfaces.token[met.triangle]]]
        own, chance = _seen_of_sheets(met.texel, clear)
        on_sheet = clear.any(axis=1)
        # Straight paths show no sky: to end by chance at the last sheet before it, or not, would be mere noise.
        is_last = on_sheet & paths.is_straight
        behind = met.point + LIFT * paths.reach[:, None] * met.direction
        is_last[is_last] = sheets.seen(behind[is_last], met.direction[is_last])[0] < 0
        passes = _passes_sheets(chance, paths.start, number + 1) & ~is_last
        seen = np.where(passes[:, None], clear / chance.clip(1e-6),
                        own / np.where(is_last, 1, 1 - chance[:, 0]).clip(1e-6)[:, None])
        self.tint[on_sheet] = met.tint[on_sheet] * seen[on_sheet]
        self.bends, self.matte = self.bends & ~on_sheet, np.where(on_sheet, 1, self.matte)
        self.passes, self.on_sheet = passes, on_sheet
        paths.is_straight = paths.is_straight & passes

    def turn(self, scene: RenderScene, met: MetSurfaces, paths: Paths, number: int) -> np.ndarray:
        """(S, 3) unit directions in which the paths go on; those that are lost at glass do not, nor after the last one.

        number: of these surfaces on the paths.
        """
        ior, leaves = met.texel[:, IOR], self.leaves
        self.tint[leaves] *= passed_plates(*(
            x[leaves] for x in (paths.entry, met.normal, met.direction, ior)))[:, None]
        side = side_normals(scene, met.triangle, met.direction)
        facet = specular = bent_to_reflect(met.normal, side, met.direction)
        if paths.start is not None:
            facet = rough_facets(met.direction, specular, met.texel[:, ROUGHNESS] * self.bends, paths.start, number + 1)
        turned = np.where(self.bends[:, None], refracted(met.direction, facet, ior, met.inside),
                          reflected(met.direction, specular))
        self.is_lost = self.bends & (lost(turned, facet, side) | (number == SURFACES - 1))
        self.tint[self.is_lost] = 0
        return np.where(self.passes[:, None], met.direction, turned)


def _set_first_lobes(ends: PathEnds, scene: RenderScene, cast: Cast, met: MetSurfaces, scattering: Scattering,
                     paths: Paths) -> None:
    """The lobes of what paths meet first: of metal and layers in reflections, of glass that refractions leave."""
    row, leaves = paths.row, scattering.leaves
    if paths.start is None:
        lobe = metal_lobe(met)
        ends.other.set(row, layer_lobe(met))
    else:
        lobe = exit_lobe(met, leaves, scattering.tint)
        if leaves.any():
            ends.other.set(row[leaves], inner_lobe(scene, cast, met.among(leaves), paths.reach[leaves]))
    ends.lobe.set(row, lobe)
    paths.shows_lamps = ~lobe.color.any(1)


def _set_gloss(ends: PathEnds, met: MetSurfaces, scattering: Scattering, paths: Paths) -> None:
    """The lobe of metal, or of the layer on what paths end at, unless they have one: then rough metal is matte."""
    mirrors, has_gloss = scattering.mirrors, ends.gloss.color[paths.row].any(1)
    is_glossy = (mirrors | ~scattering.goes_on) & ~(
        scattering.bends | scattering.on_sheet | has_gloss | scattering.is_dark)
    ends.gloss.set(paths.row[is_glossy], gloss_lobe(met.among(is_glossy)))
    paths.shows_lamps &= ~(is_glossy & mirrors)
    scattering.matte = np.where(has_gloss & mirrors, 1, scattering.matte)


def _set_diffuse(ends: PathEnds, met: MetSurfaces, scattering: Scattering, row: np.ndarray, is_last: bool) -> None:
    """The diffuse lobes that paths show which end here, and all paths after the last surface."""
    texel = met.texel
    below = 1 - (1 - texel[:, METALLIC]) * layer_share(layer_reflectance(
        texel[:, IOR], texel[:, TRANSMISSION]), -dot(met.direction, met.normal), texel[:, ROUGHNESS])
    has_albedo = ~(scattering.bends | scattering.on_sheet)
    ends.position[row], ends.normal[row] = met.point, met.normal
    ends.albedo[row] = np.where(has_albedo[:, None], texel[:, BASE_COLOR], 1)
    ends.triangle[row] = np.where(has_albedo, met.triangle, -1)
    ends.share[row] = np.where(has_albedo[:, None], met.tint, scattering.tint) * np.where(
        scattering.goes_on, is_last, scattering.matte * below * ~scattering.is_dark)[:, None]


def _passes_sheets(chance: np.ndarray, start: np.ndarray, number: int) -> np.ndarray:
    """(P,) bool: paths that pass the surface of that number, with a chance (P, 1), by the `start` (P, 2) of paths.

    All pass where they nearly do, as single pixels that show the sheet would be speckles.
    """
    chance = np.where(np.abs(chance - 0.5) > NEARLY - 0.5, chance.round(), chance)[:, 0]
    return start[:, 0] * (2 * number + 1) % 1 < chance


def _seen_of_sheets(texel: np.ndarray, clear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) own colour of sheets that let (P, 3) pass, by how much of them is there, and (P, 1) share of what passes
    in all light that they send on: of dark ones little more than that is seen."""
    share = clear.mean(axis=1, keepdims=True)
    own = (1 - share) * colors_of_texels(own_texels(texel, clear))[:2].sum(0)
    return own, share / (share + own.mean(axis=1, keepdims=True)).clip(1e-6)
