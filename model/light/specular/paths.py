# SPDX-License-Identifier: GPL-3.0-or-later
"""Specular paths: follow reflections and refractions, these through facets of rough glass, to what a pixel shows.

Whitted 1980, "An improved illumination model for shaded display", with one path per pixel and lobe.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...beams import beam_share
from ...first_hits.from_rays import colors_of_texels
from ...first_hits.seen_colors import layer_share
from ...first_hits.sheets import own_texels
from ...geometry import dot, reflected, refracted
from ...material.reflectance import layer_reflectance
from ...scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene
from ...shading import bent_to_reflect, emission_share, seen_sky, side_normals, surface
from ...surface_kinds import Ray
from .facets import rough_facets
from .glass import PURE, Cast, is_glass, lost, passed_plates, tint_of_surface
from .path_lobes import LIFT, Lobe, MetSurfaces, exit_lobe, gloss_lobe, inner_lobe, layer_lobe, metal_lobe

SURFACES = 6       # a path passes at most
SHARP, BLURRED = 0.15, 0.35  # roughness up to which a reflection is an image, and from which it is a mean over the lobe
AT_ONCE = 3e-6     # of the longest segment, within which glass and what it stands on are met at once
LAMPS = 4          # that do not shine on it a path passes at a time
NEARLY = 0.75      # chance of paths to pass a sheet from which on all do, and none with as much of the opposite

Media = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass
class PathEnds:
    """Where P specular paths end: at matte or rough surfaces, lamps, or the sky."""

    position: np.ndarray  # (P, 3) f32, world
    normal: np.ndarray    # (P, 3) f32, unit, facing the path
    share: np.ndarray     # (P, 3) f32, of the light of its diffuse lobe that the path shows; 0 = no surface
    albedo: np.ndarray    # (P, 3) f32, of that lobe
    triangle: np.ndarray  # (P,) i32, of the geometry, that has this albedo; -1 = none has
    light: np.ndarray     # (P, 3) f32, radiance of the lamp or the sky there times the tint of the path
    lobe: Lobe            # of what the paths meet first, if that is metal, or rough glass that they leave
    other: Lobe           # of the layer on what reflections meet first; of what leaves glass after one more reflection
    gloss: Lobe           # of the first metal that is met later than that, and else of the layer on what paths end at

    @classmethod
    def none(cls, count: int) -> PathEnds:
        """Those of so many paths, which show nothing yet."""
        position, normal, share, albedo, light = (np.zeros((count, 3), np.float32) for _ in range(5))
        return cls(position, normal, share, albedo, np.full(count, -1, np.int32), light,
                   *(Lobe.none(count) for _ in range(3)))

    @property
    def color(self) -> np.ndarray:
        """(P, 3) what the paths show of light that a white diffuse surface sends on."""
        return self.share * self.albedo

    def scale(self, factor: np.ndarray) -> None:
        """All that paths show becomes so many times (P, 1 or 3) as bright."""
        for color in (self.share, self.light, self.lobe.color, self.other.color, self.gloss.color):
            color *= factor


class Sheets(NamedTuple):
    """Half-transparent surfaces on the way of P paths."""

    clear: np.ndarray     # (T, 3) of first_hits.sheets.sheet_tiles
    straight: np.ndarray  # (P,) bool, paths that begin on one, as they came
    seen: Cast            # of what the camera sees, which these meet


@dataclass
class Paths:
    """S of the paths, that go on."""

    row: np.ndarray        # (S,) of all paths
    origin: np.ndarray     # (S, 3)
    direction: np.ndarray  # (S, 3) unit
    before: np.ndarray     # (S, 3) on the segment before, right before the surface at which that ends
    tint: np.ndarray       # (S, 3) share of what they show that is seen
    reach: np.ndarray      # (S,) the longest segment so far: precision depends on it
    ray: np.ndarray        # (S,) u8, of Ray
    entry: np.ndarray      # (S, 3) normals where they have entered glass, 0 outside
    is_straight: np.ndarray  # (S,) bool, have met nothing but half-transparent surfaces
    shows_lamps: np.ndarray  # (S,) bool, no lobe does that instead
    start: np.ndarray | None  # (S, 2) of `pixel_starts`

    def among(self, chosen: np.ndarray) -> Paths:
        return Paths(*(None if values is None else values[chosen] for values in vars(self).values()))


class Hits(NamedTuple):
    """What S paths meet."""

    triangle: np.ndarray  # (S,) i32, -1 for none
    distance: np.ndarray  # (S,)
    is_dark: np.ndarray   # (S,) bool, in one plane with glass

    def among(self, chosen: np.ndarray) -> Hits:
        return Hits(*(values[chosen] for values in self))


def blur(roughness):
    """0 to 1 (array or tensor): how much a reflection is a mean over the lobe instead of an image."""
    x = ((roughness - SHARP) / (BLURRED - SHARP)).clip(0, 1)
    return x * x * (3 - 2 * x)


def follow_paths(scene: RenderScene, cast: Cast, origin: np.ndarray, direction: np.ndarray, eye: np.ndarray,
                 solid: Cast | None = None, media: Media | None = None, start: np.ndarray | None = None,
                 sheets: Sheets | None = None, entry: np.ndarray | None = None, glass: Cast | None = None) -> PathEnds:
    """Follow paths from world points (P, 3) along unit directions (P, 3); none may start at a lamp.

    A path that has met SURFACES surfaces ends at the last one as if that were matte, or is lost in glass. eye: (3,) or
    (P, 3), the point from which the origins are seen. cast(origins, directions), such as `Rays.closest`, returns the
    nearest triangle (S,) i32, -1 for none, and its distance (S,). solid: the same for everything but glass, so that
    paths end at what glass touches; glass: for glass alone. What lies in exactly the same plane as glass is black
    behind that, as in Cycles, whose rays go to and fro between both. media: share of light (S, 1 or 3) that gets from
    points (S, 3) along directions (S, 3) for distances (S,). start: (P, 2) of `pixel_starts`, of refractions, which
    meet facets of rough glass; None of reflections, which take glass for smooth. sheets: of refractions, where some
    begin on half-transparent surfaces; what shines straight behind these is not in the light, nor are lamps that the
    `lobe` shows. entry: (P, 3) normals of the sides at which paths have entered glass; by default, and 0, they have
    not.
    """
    ends, shines = PathEnds.none(len(origin)), scene.is_light
    none, reach = np.zeros((len(origin), 3), np.float32), np.linalg.norm(origin - eye, axis=1)
    paths = Paths(
        np.arange(len(origin)), origin + LIFT * reach[:, None] * direction, direction, origin - LIFT * (origin - eye),
        np.ones_like(none), reach, np.full(len(origin), Ray.GLOSSY if start is None else Ray.TRANSMISSION, np.uint8),
        none if entry is None else entry, np.zeros(len(origin), bool) if sheets is None else sheets.straight,
        np.ones(len(origin), bool), start)
    for number in range(SURFACES):
        if not len(paths.row):
            break
        hits = _hits(scene, paths, cast, solid, glass, sheets)
        if media is not None:
            until = np.where(hits.triangle < 0, np.inf, hits.distance)
            paths.tint = paths.tint * media(paths.origin, paths.direction, until)
        goes_on = (hits.triangle >= 0) & ~shines[scene.surfaces.token[hits.triangle]]
        past = paths.among(~goes_on)
        ends.light[past.row] = past.tint * _arriving(scene, past, hits.among(~goes_on))
        paths = _scattered(scene, cast, paths.among(goes_on), hits.among(goes_on), sheets, number, ends)
    return ends


def _scattered(scene: RenderScene, cast: Cast, paths: Paths, hits: Hits, sheets: Sheets | None, number: int,
               ends: PathEnds) -> Paths:
    """The paths that go on from the surfaces that they meet, as those of that number, which are noted in `ends`."""
    row, direction, arrived, triangle = paths.row, paths.direction, paths.tint, hits.triangle
    is_last = number == SURFACES - 1
    point = paths.origin + hits.distance[:, None] * direction
    reach = paths.reach = np.maximum(paths.reach, hits.distance)
    if scene.glow is not None:
        glow = scene.glow[scene.surfaces.token[triangle]] * emission_share(scene, triangle, point)
        ends.light[row] += paths.tint * glow * ~paths.is_straight[:, None]
    normal, inside, texel = surface(scene, triangle, point, direction)
    side = side_normals(scene, triangle, direction)
    metallic, transmission, roughness = texel[:, METALLIC], texel[:, TRANSMISSION], texel[:, ROUGHNESS]
    bends = is_glass(texel, inside)
    leaves = bends & inside
    tint = arrived * np.where(bends[:, None], tint_of_surface(texel, inside), texel[:, BASE_COLOR])
    matte, mirrors = (1 - metallic) * (1 - transmission), metallic > PURE
    passes = on_sheet = np.zeros(len(row), bool)
    if sheets is not None:
        clear = sheets.clear[scene.tile_index[scene.surfaces.token[triangle]]]
        own, chance = _seen_of_sheets(texel, clear)
        passes, on_sheet = _passes_sheets(chance, paths.start, number + 1), clear.any(axis=1)
        # Straight paths show no sky: to end by chance at the last sheet before it, or not, would be mere noise.
        is_last_sheet = on_sheet & paths.is_straight
        behind = point + LIFT * reach[:, None] * direction
        is_last_sheet[is_last_sheet] = sheets.seen(behind[is_last_sheet], direction[is_last_sheet])[0] < 0
        passes &= ~is_last_sheet
        seen = np.where(passes[:, None], clear / chance.clip(1e-6), own / np.where(
            is_last_sheet, 1, 1 - chance[:, 0]).clip(1e-6)[:, None])
        tint[on_sheet] = arrived[on_sheet] * seen[on_sheet]
        bends, matte = bends & ~on_sheet, np.where(on_sheet, 1, matte)
        paths.is_straight = paths.is_straight & passes
    tint[leaves] *= passed_plates(*(x[leaves] for x in (paths.entry, normal, direction, texel[:, IOR])))[:, None]
    facet = specular = bent_to_reflect(normal, side, direction)
    if paths.start is not None:
        facet = rough_facets(direction, specular, roughness * bends, paths.start, number + 1)
    turned = np.where(bends[:, None], refracted(direction, facet, texel[:, IOR], inside),
                      reflected(direction, specular))
    is_lost = bends & (lost(turned, facet, side) | is_last)
    tint[is_lost] = 0
    paths.shows_lamps = np.ones(len(row), bool)
    met = MetSurfaces(point, normal, texel, direction, arrived)
    if number == 0 and paths.start is None:
        lobe = metal_lobe(met)
        ends.other.set(row, layer_lobe(met))
    elif number == 0:
        lobe = exit_lobe(met, leaves, tint)
        if leaves.any():
            ends.other.set(row[leaves], inner_lobe(scene, cast, met.among(leaves), reach[leaves]))
    if number == 0:
        ends.lobe.set(row, lobe)
        paths.shows_lamps = ~lobe.color.any(1)
    goes_on = (bends | passes | mirrors & (roughness < BLURRED)) & ~is_lost & ~hits.is_dark
    if number > 0 or paths.start is not None:
        has_gloss = ends.gloss.color[row].any(1)
        glossy = (mirrors | ~goes_on) & ~bends & ~on_sheet & ~has_gloss & ~hits.is_dark
        ends.gloss.set(row[glossy], gloss_lobe(met.among(glossy)))
        paths.shows_lamps &= ~(glossy & mirrors)
        matte = np.where(has_gloss & mirrors, 1, matte)  # one lobe of a path is enough
    below = 1 - (1 - metallic) * layer_share(
        layer_reflectance(texel[:, IOR], transmission), -dot(direction, normal), roughness)
    ends.position[row], ends.normal[row] = point, normal
    has_albedo = ~(bends | on_sheet)
    ends.albedo[row] = np.where(has_albedo[:, None], texel[:, BASE_COLOR], 1)
    ends.triangle[row] = np.where(has_albedo, triangle, -1)
    ends.share[row] = np.where(has_albedo[:, None], arrived, tint) * np.where(
        goes_on, is_last, matte * below * ~hits.is_dark)[:, None]
    paths.tint, paths.entry = tint, np.where((bends & ~inside)[:, None], normal, 0)
    paths.ray = np.where(bends, np.uint8(Ray.TRANSMISSION), np.uint8(Ray.GLOSSY))
    paths.before = point - LIFT * reach[:, None] * direction
    paths.direction = np.where(passes[:, None], direction, turned)
    paths.origin = point + LIFT * reach[:, None] * paths.direction
    return paths.among(goes_on)


def _hits(scene: RenderScene, paths: Paths, cast: Cast, solid: Cast | None, glass: Cast | None,
          sheets: Sheets | None) -> Hits:
    """Arguments as of `follow_paths`."""
    triangle, distance = _met(scene, cast, paths.origin, paths.direction, paths.reach)
    if sheets is not None and (rows := paths.is_straight).any():
        triangle[rows], distance[rows] = sheets.seen(paths.origin[rows], paths.direction[rows])[:2]
    if solid is not None:
        touched, gap = solid(paths.before, paths.direction)[:2]
        touches = (touched >= 0) & (gap < 3 * LIFT * paths.reach)
        triangle, distance = np.where(touches, touched, triangle), np.where(touches, 0, distance)
    is_dark = np.zeros(len(triangle), bool)
    if glass is not None:
        rows = np.flatnonzero(paths.ray == Ray.TRANSMISSION)
        wall, to_wall = _met_at_once(solid, glass, *(
            x[rows] for x in (paths.origin, paths.direction, distance, paths.reach)))
        rows, wall, to_wall = (x[wall >= 0] for x in (rows, wall, to_wall))
        triangle[rows], distance[rows], is_dark[rows] = wall, to_wall, True
    return Hits(triangle, distance, is_dark)


def _met(scene: RenderScene, cast: Cast, origin: np.ndarray, direction: np.ndarray,
         reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest triangle (P,) and its distance (P,), past lamps that do not shine this way: rays pass these."""
    triangle, distance = cast(origin, direction)[:2]
    is_lamp, token = ~scene.is_seen & scene.beam_axis.any(axis=1), scene.surfaces.token
    for _ in range(LAMPS):
        rows = np.flatnonzero(triangle >= 0)
        rows = rows[is_lamp[token[triangle[rows]]]]
        lamp = token[triangle[rows]]
        rows = rows[beam_share(-dot(scene.beam_axis[lamp], direction[rows]), scene.beam_cosine[lamp]) == 0]
        if not len(rows):
            break
        start = distance[rows] + LIFT * np.maximum(reach[rows], distance[rows])
        triangle[rows], beyond = cast(origin[rows] + start[:, None] * direction[rows], direction[rows])[:2]
        distance[rows] = start + beyond
    return triangle, distance


def _met_at_once(solid: Cast, glass: Cast, origin: np.ndarray, direction: np.ndarray, distance: np.ndarray,
                 reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The triangle (P,) of what is in one plane with glass where both are met first, -1 where nothing is; its distance.

    distance: (P,), of what is met first.
    """
    (wall, to_wall), (pane, to_pane) = (met(origin, direction)[:2] for met in (solid, glass))
    is_both = (wall >= 0) & (pane >= 0)
    gap, longest = np.where(is_both, to_wall, 0) - np.where(is_both, to_pane, np.inf), np.maximum(reach, distance)
    is_first = to_wall <= distance + AT_ONCE * longest
    return np.where((np.abs(gap) < AT_ONCE * longest) & is_first, wall, -1), to_wall


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


def _arriving(scene: RenderScene, paths: Paths, hits: Hits) -> np.ndarray:
    """(S, 3) radiance of the lamps, or for those that meet nothing of the sky, at which paths end."""
    is_sky = hits.triangle < 0
    token = np.where(is_sky, -1, scene.surfaces.token[hits.triangle])
    axis = scene.beam_axis[token]
    share = np.where(axis.any(1), beam_share(-dot(axis, paths.direction), scene.beam_cosine[token]), 1)
    sky = seen_sky(scene, paths.direction, paths.ray)
    arriving = np.where(is_sky[:, None], sky, scene.emission[token] * share[:, None])
    point = paths.origin + np.where(is_sky, 0, hits.distance)[:, None] * paths.direction
    arriving *= emission_share(scene, hits.triangle, point)
    return arriving * (paths.shows_lamps | is_sky)[:, None] * ~paths.is_straight[:, None]
