# SPDX-License-Identifier: GPL-3.0-or-later
"""Follow mirror reflections and refractions through the token triangles to the surface that a pixel shows.

Whitted 1980, "An improved illumination model for shaded display", with one path per pixel and lobe.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry import reflected, refracted, seen_in
from ..scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene, tint_of_glass
from ..shading import surface

SURFACES = 6       # a path passes at most
SMOOTH = 0.5       # roughness up to which a metal is a mirror
PURE = 0.5         # metallic from which a surface is a mirror
CLEAR = 0.75       # transmission from which one is glass and shows no matte surface of its own
LIFTED = 1e-4      # of the longest way so far, that a ray starts off the surface it leaves
SHARP, BLURRED = 0.15, 0.35  # roughness up to which what is seen is an image, and from which it is a mean of all around

Cast = Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]]


@dataclass
class Ends:
    """Where P paths end: at matte surfaces, lamps, or the sky."""

    position: np.ndarray  # (P, 3) f32, world
    normal: np.ndarray    # (P, 3) f32, unit, facing the path
    color: np.ndarray     # (P, 3) f32: diffuse colour there times that of what was passed; 0 = no surface
    light: np.ndarray     # (P, 3) f32: radiance of the lamp or the sky there, times the same


def blur(roughness):
    """Array or tensor, 0 to 1: how far what a surface shows is not an image but a mean of all around."""
    x = ((roughness - SHARP) / (BLURRED - SHARP)).clip(0, 1)
    return x * x * (3 - 2 * x)


def follow(scene: RenderScene, cast: Cast, origin: np.ndarray, direction: np.ndarray, eye: np.ndarray,
           solid: Cast | None = None) -> Ends:
    """Paths from world points (P, 3) along unit directions (P, 3), none of which starts at a lamp.

    One that has passed so many surfaces ends at the last as if it were matte: in the light that is around it.
    eye: (3,) or (P, 3), where what is seen at these points is seen from.
    cast(origins, directions), such as `Rays.closest`, gives the nearest triangle (S,) i32, -1 if none, its distance
    (S,), and whatever else. solid: the same of those that are no glass, by which paths end at what glass touches.
    """
    ends = Ends(*(np.zeros((len(origin), 3), np.float32) for _ in range(4)))
    path, share = np.arange(len(origin)), np.ones((len(origin), 3), np.float32)
    reach = np.linalg.norm(origin - eye, axis=1)  # the longest way so far: precision depends on it
    before, origin = origin - LIFTED * (origin - eye), origin + LIFTED * reach[:, None] * direction
    for left in reversed(range(SURFACES)):
        if not len(path):
            break
        triangle, distance = cast(origin, direction)[:2]
        if solid is not None:
            other, way = solid(before, direction)[:2]
            touches = (other >= 0) & (way < 3 * LIFTED * reach)
            triangle, distance = np.where(touches, other, triangle), np.where(touches, 0, distance)
        hit = (triangle >= 0) & ~scene.is_light[triangle]
        ends.light[path[~hit]] = share[~hit] * _light(scene, triangle[~hit], direction[~hit])
        path, share, origin, direction, triangle, distance, reach = (
            x[hit] for x in (path, share, origin, direction, triangle, distance, reach))
        point, reach = origin + distance[:, None] * direction, np.maximum(reach, distance)
        normal, inside, texel = surface(scene, triangle, point, direction)
        base, metallic, transmission = texel[:, BASE_COLOR], texel[:, METALLIC], texel[:, TRANSMISSION]
        glass = (transmission > CLEAR) & (metallic <= PURE)
        passed = share * np.where(glass[:, None], tint_of_glass(base), base)
        ends.position[path], ends.normal[path] = point, normal
        matte = np.where(metallic > PURE, 1, (1 - metallic) * (1 - transmission))  # a rough metal counts as matte
        goes_on = glass | (metallic > PURE) & (texel[:, ROUGHNESS] < SMOOTH)
        ends.color[path] = passed * np.where(goes_on, not left, matte)[:, None]
        before = point - LIFTED * reach[:, None] * direction
        direction = np.where(glass[:, None], refracted(direction, normal, texel[:, IOR], inside),
                             reflected(direction, normal))
        origin = point + LIFTED * reach[:, None] * direction
        path, share, before, origin, direction, reach = (
            x[goes_on] for x in (path, passed, before, origin, direction, reach))
    return ends


def _light(scene: RenderScene, triangle: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(P, 3) radiance of lamps (P,), -1 = none, or of the sky along world unit vectors (P, 3); spots show nothing."""
    sky = 0.0 if scene.environment is None else seen_in(scene.environment, direction)
    shining = scene.emission[triangle] * ~scene.beam_axis[triangle].any(1, keepdims=True)
    return np.where(triangle[:, None] < 0, sky, shining)
