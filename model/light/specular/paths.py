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
from ...material.reflectance import LEAST_LAYER, fresnel, layer_reflectance
from ...scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene
from ...shading import bent_to_reflect, emission_share, seen_sky, side_normals, surface
from ...surface_kinds import Ray
from .facets import LEAST_ROUGHNESS, exit_lobe, rough_facets
from .glass import PURE, TURBID, Cast, is_glass, lost, passed_plates, tint_of_surface

SURFACES = 6       # a path passes at most
LIFT = 1e-4        # of the longest segment so far, that a ray starts off its surface
SHARP, BLURRED = 0.15, 0.35  # roughness up to which a reflection is an image, and from which it is a mean over the lobe
AT_ONCE = 3e-6     # of the longest segment, within which glass and what it stands on are met at once
LAMPS = 4          # that do not shine on it a path passes at a time
LEAST_BLUR = 0.03  # roughness of smooth surfaces in which lamps are mirrored

Media = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass
class PathEnds:
    """Where P specular paths end: at matte or rough surfaces, lamps, or the sky."""

    position: np.ndarray  # (P, 3) f32, world
    normal: np.ndarray    # (P, 3) f32, unit, facing the path
    color: np.ndarray     # (P, 3) f32, diffuse albedo there times the tint of the path; 0 = no surface
    light: np.ndarray     # (P, 3) f32, radiance of the lamp or the sky there times the tint of the path
    lobe: Lobe            # of what the paths meet first, if that is metal, or rough glass that they leave
    other: Lobe           # of the layer on what reflections meet first; of what leaves glass after one more reflection
    gloss: Lobe           # of the first metal that is met later than that, and else of the layer on what paths end at

    def scale(self, factor: np.ndarray) -> None:
        """All that paths show becomes so many times (P, 1 or 3) as bright."""
        for color in (self.color, self.light, self.lobe.color, self.other.color, self.gloss.color):
            color *= factor


@dataclass
class Lobe:
    """P points whose lobe shows lamps, and, but for polished metal and where glass is left, all that is around."""

    position: np.ndarray   # (P, 3) f32, world
    normal: np.ndarray     # (P, 3) f32, unit, of metal, facing the path; where glass is left, axis of the lobe
    color: np.ndarray      # (P, 3) f32; 0 = none
    roughness: np.ndarray  # (P, 1) f32
    f0: np.ndarray | float = 1.0  # (P, 1) f32, at normal incidence, of what it reflects at grazing angles
    viewer: np.ndarray | float = 0.0  # (P, 3) f32, unit, from where it is seen; 0 where that is the first hit

    def set(self, rows: np.ndarray, lobe: Lobe) -> None:
        for own, other in zip(vars(self).values(), vars(lobe).values(), strict=True):
            own[rows] = other


class Sheets(NamedTuple):
    """Half-transparent surfaces on the way of P paths."""

    clear: np.ndarray     # (T, 3) of first_hits.sheets.sheet_tiles
    straight: np.ndarray  # (P,) bool, paths that begin on one, as they came
    seen: Cast            # of what the camera sees, which these meet


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
    zeros = lambda channels: np.zeros((len(origin), channels), np.float32)  # noqa: E731
    ends = PathEnds(*map(zeros, (3, 3, 3, 3)), *(Lobe(*map(zeros, (3, 3, 3, 1, 1, 3))) for _ in range(3)))
    shows_lamps = np.ones(len(origin), bool)
    straight = None if sheets is None else sheets.straight.copy()
    path, tint = np.arange(len(origin)), np.ones((len(origin), 3), np.float32)
    entry = zeros(3) if entry is None else entry
    kind = np.full(len(origin), Ray.GLOSSY if start is None else Ray.TRANSMISSION, np.uint8)
    token, is_light = np.append(scene.surfaces.token, -1), scene.is_light
    reach = np.linalg.norm(origin - eye, axis=1)  # the longest segment so far: precision depends on it
    before, origin = origin - LIFT * (origin - eye), origin + LIFT * reach[:, None] * direction
    for remaining in reversed(range(SURFACES)):
        if not len(path):
            break
        triangle, distance = _met(scene, cast, origin, direction, reach)
        if sheets is not None and (rows := straight[path]).any():
            triangle[rows], distance[rows] = sheets.seen(origin[rows], direction[rows])[:2]
        if solid is not None:
            touched, gap = solid(before, direction)[:2]
            touches = (touched >= 0) & (gap < 3 * LIFT * reach)
            triangle, distance = np.where(touches, touched, triangle), np.where(touches, 0, distance)
        is_dark = np.zeros(len(path), bool)
        if glass is not None:
            rows = np.flatnonzero(kind == Ray.TRANSMISSION)
            wall, to_wall = _met_at_once(solid, glass, *(x[rows] for x in (origin, direction, distance, reach)))
            rows, wall, to_wall = (x[wall >= 0] for x in (rows, wall, to_wall))
            triangle[rows], distance[rows], is_dark[rows] = wall, to_wall, True
        if media is not None:
            tint = tint * media(origin, direction, np.where(triangle < 0, np.inf, distance))
        hit = (triangle >= 0) & ~is_light[token[triangle]]
        arriving = _emitted(scene, token[triangle[~hit]], direction[~hit], kind[~hit])
        arriving *= _share_of_mean(scene, triangle[~hit], *(x[~hit] for x in (origin, direction, distance)))
        arriving *= (shows_lamps[path[~hit]] | (triangle[~hit] < 0))[:, None]
        if sheets is not None:
            arriving *= ~straight[path[~hit], None]
        ends.light[path[~hit]] = tint[~hit] * arriving
        path, tint, origin, direction, entry, triangle, distance, reach, is_dark = (
            x[hit] for x in (path, tint, origin, direction, entry, triangle, distance, reach, is_dark))
        point, reach = origin + distance[:, None] * direction, np.maximum(reach, distance)
        if scene.glow is not None:
            glow = scene.glow[token[triangle]] * emission_share(scene, triangle, point)
            ends.light[path] += tint * (glow if straight is None else glow * ~straight[path, None])
        normal, inside, texel = surface(scene, triangle, point, direction)
        base, metallic, transmission = texel[:, BASE_COLOR], texel[:, METALLIC], texel[:, TRANSMISSION]
        bends = is_glass(texel, inside)
        leaves = bends & inside
        arrived = tint
        tint = tint * np.where(bends[:, None], tint_of_surface(texel, inside), base)
        matte, mirrors = (1 - metallic) * (1 - transmission), metallic > PURE
        passes = on_sheet = np.zeros(len(path), bool)
        if sheets is not None:
            clear = sheets.clear[scene.tile_index[token[triangle]]]
            passes, on_sheet = _passes_sheets(clear, start[path], SURFACES - remaining)
            tint[on_sheet] = arrived[on_sheet] * _seen_of_sheets(texel, clear, passes)[on_sheet]
            bends, matte = bends & ~on_sheet, np.where(on_sheet, 1, matte)
            straight[path] &= passes
        tint[leaves] *= passed_plates(*(x[leaves] for x in (entry, normal, direction, texel[:, IOR])))[:, None]
        entry = np.where((bends & ~inside)[:, None], normal, 0)
        side = side_normals(scene, triangle, direction)
        facet = specular = bent_to_reflect(normal, side, direction)
        shows_lamps[path] = True
        if start is not None:
            facet = rough_facets(direction, specular, texel[:, ROUGHNESS] * bends, start[path], SURFACES - remaining)
        turned = np.where(bends[:, None], refracted(direction, facet, texel[:, IOR], inside),
                          reflected(direction, specular))
        is_lost = bends & (lost(turned, facet, side) | (remaining == 0))
        tint[is_lost] = 0
        if remaining == SURFACES - 1:
            lobe = _metal_lobe(point, normal, texel) if start is None else _exit_lobe(
                point, normal, texel, direction, leaves, tint)
            ends.lobe.set(path, lobe)
            shows_lamps[path] = ~lobe.color.any(1)
            if start is None:
                ends.other.set(path, _layer_lobe(point, normal, texel))
            elif leaves.any():
                ends.other.set(path[leaves], _inner_lobe(scene, cast, *(
                    x[leaves] for x in (point, normal, texel, direction, arrived, reach))))
        ends.position[path], ends.normal[path] = point, normal
        goes_on = (bends | passes | mirrors & (texel[:, ROUGHNESS] < BLURRED)) & ~is_lost & ~is_dark
        if start is not None or remaining < SURFACES - 1:
            has_gloss = ends.gloss.color[path].any(1)
            rows = (mirrors | ~goes_on) & ~bends & ~on_sheet & ~has_gloss & ~is_dark
            ends.gloss.set(path[rows], _gloss_lobe(*(x[rows] for x in (point, normal, texel, direction, arrived))))
            shows_lamps[path[rows & mirrors]] = False
            matte = np.where(has_gloss & mirrors, 1, matte)  # one lobe of a path is enough
        below = 1 - (1 - metallic) * layer_share(
            layer_reflectance(texel[:, IOR], transmission), -dot(direction, normal), texel[:, ROUGHNESS])
        ends.color[path] = tint * np.where(goes_on, not remaining, matte * below * ~is_dark)[:, None]
        before = point - LIFT * reach[:, None] * direction
        kind = np.where(bends, np.uint8(Ray.TRANSMISSION), np.uint8(Ray.GLOSSY))
        direction = np.where(passes[:, None], direction, turned)
        origin = point + LIFT * reach[:, None] * direction
        path, kind, tint, before, origin, direction, entry, reach = (
            x[goes_on] for x in (path, kind, tint, before, origin, direction, entry, reach))
    return ends


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


def _passes_sheets(clear: np.ndarray, start: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
    """(P,) bool each: paths that pass the surface of that number, which lets (P, 3) pass straight, and those at sheets.

    As much of light as is clear passes, by the `start` (P, 2) of paths.
    """
    return start[:, 0] * (2 * number + 1) % 1 < clear.mean(axis=1), clear.any(axis=1)


def _seen_of_sheets(texel: np.ndarray, clear: np.ndarray, passes: np.ndarray) -> np.ndarray:
    """(P, 3) colour of sheets, or of what passes them."""
    share = clear.mean(axis=1, keepdims=True)
    own = colors_of_texels(own_texels(texel, clear))[:2].sum(0)
    return np.where(passes[:, None], clear / share.clip(1e-6), own)


def _metal_lobe(point: np.ndarray, normal: np.ndarray, texel: np.ndarray) -> Lobe:
    """At points (P, 3) of surfaces with these normals (P, 3) and material texels (P, C)."""
    mirrors = texel[:, METALLIC, None] > PURE
    return Lobe(point, normal, texel[:, BASE_COLOR] * mirrors, texel[:, ROUGHNESS, None])


def _layer_lobe(point: np.ndarray, normal: np.ndarray, texel: np.ndarray) -> Lobe:
    """The same of a dielectric layer, or of glass."""
    f0 = layer_reflectance(texel[:, IOR, None], texel[:, TRANSMISSION, None])
    color = np.repeat((1 - texel[:, METALLIC, None]) * (f0 > LEAST_LAYER), 3, axis=1)
    return Lobe(point, normal, color, texel[:, ROUGHNESS, None].clip(LEAST_BLUR), f0)


def _gloss_lobe(point: np.ndarray, normal: np.ndarray, texel: np.ndarray, direction: np.ndarray,
                tint: np.ndarray) -> Lobe:
    """That of metal, and else of the layer, for paths of a tint (P, 3) along unit directions (P, 3)."""
    metal, layer = (make(point, normal, texel) for make in (_metal_lobe, _layer_lobe))
    mirrors = metal.color.any(1, keepdims=True)
    color, roughness, f0 = (np.where(mirrors, *kinds) for kinds in (
        (metal.color, layer.color), (metal.roughness, layer.roughness), (1, layer.f0)))
    return Lobe(point, normal, tint * color, roughness, f0, -direction)


def _inner_lobe(scene: RenderScene, cast: Cast, point: np.ndarray, normal: np.ndarray, texel: np.ndarray,
                direction: np.ndarray, tint: np.ndarray, reach: np.ndarray) -> Lobe:
    """The same where paths that are reflected at such points, inside of glass, leave it next."""
    ior, first = texel[:, IOR].clip(1), texel[:, ROUGHNESS, None]
    mirrors = texel[:, METALLIC, None] * texel[:, BASE_COLOR]
    inner = fresnel(-dot(direction, normal), 1 / ior)[:, None]
    direction = reflected(direction, normal)
    origin = point + LIFT * reach[:, None] * direction
    triangle, distance = cast(origin, direction)[:2]
    point = origin + np.where(triangle < 0, 0, distance)[:, None] * direction
    normal, inside, texel = surface(scene, triangle, point, direction)
    lobe = _exit_lobe(point, normal, texel, direction, inside & (triangle >= 0), tint * (
        mirrors + (1 - mirrors) * inner) * tint_of_surface(texel, inside), least=-1)
    lobe.roughness = ((lobe.roughness ** 4 + first ** 4) ** 0.25).clip(LEAST_BLUR, 1).astype(np.float32)
    return lobe


def _exit_lobe(point: np.ndarray, normal: np.ndarray, texel: np.ndarray, direction: np.ndarray,
               is_inside: np.ndarray, tint: np.ndarray, least: float = LEAST_ROUGHNESS) -> Lobe:
    """The same where paths of a tint (P, 3) leave glass that they are inside of (P,), along unit directions (P, 3)."""
    axis, roughness, share = exit_lobe(direction, normal, texel[:, ROUGHNESS], texel[:, IOR].clip(1), least)
    share = is_inside * share * np.maximum(texel[:, TRANSMISSION], TURBID)
    return Lobe(point, axis, tint * share[:, None], roughness[:, None])


def _share_of_mean(scene: RenderScene, triangle: np.ndarray, origin: np.ndarray, direction: np.ndarray,
                   distance: np.ndarray) -> np.ndarray:
    """(P, 3) of the radiance of triangles (P,) that is met so far (P,) from points along unit vectors (P, 3)."""
    return emission_share(scene, triangle, origin + np.where(triangle < 0, 0, distance)[:, None] * direction)


def _emitted(scene: RenderScene, token: np.ndarray, direction: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """(P, 3) radiance of tokens (P,) that shine, or for -1 of the sky, along unit vectors (P, 3) of these rays (P,)."""
    sky = seen_sky(scene, direction, ray)
    axis = scene.beam_axis[token]
    share = np.where(axis.any(1), beam_share(-dot(axis, direction), scene.beam_cosine[token]), 1)
    return np.where(token[:, None] < 0, sky, scene.emission[token] * share[:, None])
