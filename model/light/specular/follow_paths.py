# SPDX-License-Identifier: GPL-3.0-or-later
"""Follow specular paths, reflections and refractions, these through facets of rough glass, to what a pixel shows.

Whitted 1980, "An improved illumination model for shaded display", with one path per pixel and lobe.
"""
from __future__ import annotations

import numpy as np

from ...beams import beam_share
from ...geometry import dot, unit
from ...scene import RenderScene
from ...shading import emission_share, seen_sky
from ...surface_kinds import Ray
from .glass import Cast
from .path_lobes import LIFT, first_reach
from .paths import SURFACES, Casts, Hits, Media, PathEnds, Paths, Sheets
from .scattering import scattered

AT_ONCE = 3e-6     # of the longest segment, within which glass and what it stands on are met at once
LAMPS = 4          # that do not shine on it a path passes at a time


def follow_paths(scene: RenderScene, casts: Casts, origin: np.ndarray, direction: np.ndarray, eye: np.ndarray,
                 media: Media | None = None, start: np.ndarray | None = None, sheets: Sheets | None = None,
                 entry: np.ndarray | None = None, fire: Media | None = None) -> PathEnds:
    """Follow paths from world points (P, 3) along unit directions (P, 3); none may start at a lamp.

    A path that has met SURFACES surfaces ends at the last one as if that were matte, or is lost in glass. eye: (3,) or
    (P, 3), the point from which the origins are seen. What lies in exactly the same plane as glass is black behind
    that, as in Cycles, whose rays go to and fro between both. media: share of light (S, 1 or 3) that gets from points
    (S, 3) along directions (S, 3) for distances (S,); fire: the radiance (S, 3) that they add to it. start: (P, 2) of
    `pixel_starts`, of refractions, which meet facets of rough glass; None of reflections, which take glass for smooth.
    sheets: of refractions, where some begin on half-transparent surfaces; what shines straight behind these is not in
    the light, nor are lamps that the `lobe` shows. entry: (P, 3) normals of the sides at which paths have entered
    glass; by default, and 0, they have not.
    """
    ends, shines, reach = PathEnds.none(len(origin)), scene.is_light, first_reach(origin, eye)
    none, lift = np.zeros((len(origin), 3), np.float32), LIFT * reach[:, None]
    paths = Paths(
        np.arange(len(origin)), origin + lift * direction, direction, origin - lift * unit(origin - eye),
        np.ones_like(none), reach, np.full(len(origin), Ray.GLOSSY if start is None else Ray.TRANSMISSION, np.uint8),
        none if entry is None else entry, np.zeros(len(origin), bool) if sheets is None else sheets.straight,
        np.ones(len(origin), bool), start)
    for number in range(SURFACES):
        if not len(paths.row):
            break
        hits = _find_hits(scene, paths, casts, sheets)
        segment = paths.origin, paths.direction, np.where(hits.triangle < 0, np.inf, hits.distance)
        if fire is not None:
            ends.light[paths.row] += paths.tint * fire(*segment) * ~paths.is_straight[:, None]
        if media is not None:
            paths.tint = paths.tint * media(*segment)
        goes_on = (hits.triangle >= 0) & ~shines[scene.surfaces.token[hits.triangle]]
        past = paths.among(~goes_on)
        ends.light[past.row] += past.tint * _arriving(scene, past, hits.among(~goes_on))
        paths = scattered(scene, casts.everything, paths.among(goes_on), hits.among(goes_on), sheets, number, ends)
    return ends


def _find_hits(scene: RenderScene, paths: Paths, casts: Casts, sheets: Sheets | None) -> Hits:
    """Arguments as of `follow_paths`."""
    triangle, distance = _met(scene, casts.everything, paths.origin, paths.direction, paths.reach)
    if sheets is not None and (rows := paths.is_straight).any():
        triangle[rows], distance[rows] = sheets.seen(paths.origin[rows], paths.direction[rows])[:2]
    if casts.solid is not None:
        touched, gap = casts.solid(paths.before, paths.direction)[:2]
        touches = (touched >= 0) & (gap < 3 * LIFT * paths.reach)
        triangle, distance = np.where(touches, touched, triangle), np.where(touches, 0, distance)
    is_dark = np.zeros(len(triangle), bool)
    if casts.glass is not None:
        rows = np.flatnonzero(paths.ray == Ray.TRANSMISSION)
        wall, to_wall = _met_at_once(casts, *(
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


def _met_at_once(casts: Casts, origin: np.ndarray, direction: np.ndarray, distance: np.ndarray,
                 reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The triangle (P,) of what is in one plane with glass where both are met first, -1 where nothing is; its distance.

    distance: (P,), of what is met first.
    """
    (wall, to_wall), (pane, to_pane) = (met(origin, direction)[:2] for met in (casts.solid, casts.glass))
    is_both = (wall >= 0) & (pane >= 0)
    gap, longest = np.where(is_both, to_wall, 0) - np.where(is_both, to_pane, np.inf), np.maximum(reach, distance)
    is_first = to_wall <= distance + AT_ONCE * longest
    return np.where((np.abs(gap) < AT_ONCE * longest) & is_first, wall, -1), to_wall


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
