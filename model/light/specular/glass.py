# SPDX-License-Identifier: GPL-3.0-or-later
"""What surfaces of glass do to specular paths: tint them, lose them, and, in plates, mirror them at both sides."""
from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ...geometry import LEAST_IOR, dot, refracted
from ...material.reflectance import fresnel
from ...scene import BASE_COLOR, IOR, METALLIC, TRANSMISSION, RenderScene, tint_of_glass
from ...shading import surface

PURE = 0.5         # metallic from which a surface is a mirror
CLEAR = 0.75       # transmission from which one is glass and shows no matte surface of its own
LEAST_CLEAR = 0.1  # the same of its inside, which only light meets that has passed it
TURBID = 0.6       # transmission below which the inside lets less light out
PARALLEL = 0.97    # cosine between normals of both sides, from which these are a plate

Cast = Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]]


def is_glass(texel: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """(P,) bool: whether paths pass surfaces with material texels (P, C), from their inside or outside (P,)."""
    return (texel[:, TRANSMISSION] > np.where(inside, LEAST_CLEAR, CLEAR)) & (texel[:, METALLIC] <= PURE)


def tint_of_surface(texel: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """(P, 3) of glass with material texels (P, C), for what passes it from its inside or outside (P,)."""
    base, metallic, transmission = texel[:, BASE_COLOR], texel[:, METALLIC, None], texel[:, TRANSMISSION, None]
    kept = 1 - metallic * np.where(inside[:, None], 1 - base, 1)  # metal mirrors some, inside once more
    return kept * tint_of_glass(base) * np.where(inside[:, None], (transmission / TURBID).clip(max=1), 1)


def lost(ray: np.ndarray, normal: np.ndarray, side: np.ndarray) -> np.ndarray:
    """(P,) bool: whether rays (P, 3), turned by shading normals (P, 3), end there, as in Cycles: those that pass a
    surface by these and not by its sides (P, 3), or that are mirrored by these into it."""
    return dot(ray, side) * dot(ray, normal) < 0


def passed_plates(entry: np.ndarray, normal: np.ndarray, ray: np.ndarray, ior: np.ndarray) -> np.ndarray:
    """(P,) share of what has entered glass at sides with normals `entry` (P, 3) and leaves it at others, with (P, 3).

    1 where these are not parallel: what is mirrored there leaves elsewhere, and as much comes from elsewhere. All
    normals face the rays (P, 3).
    """
    mirrored = fresnel(-dot(ray, normal), 1 / ior.clip(LEAST_IOR))
    return np.where(dot(entry, normal) > PARALLEL, 1 / (1 + mirrored), 1)


def mirrored_by_plates(scene: RenderScene, cast: Cast, point: np.ndarray, lift: np.ndarray, ray: np.ndarray,
                       normal: np.ndarray, texel: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """(P, 3) f32, by how much plates of glass mirror more than their near side, where rays (P, 3) meet that.

    The far side mirrors the same, along with what goes to and fro between both. point, normal: (P, 3), of the near
    side; lift: (P, 1), how far a ray starts off it.
    """
    gain = np.ones((len(point), 3), np.float32)
    rows = np.flatnonzero(is_glass(texel, inside) & ~inside)
    point, lift, ray, entry, near = (x[rows] for x in (point, lift, ray, normal, texel))
    within = refracted(ray, entry, near[:, IOR], np.zeros(len(rows), bool))
    triangle, distance = cast(point + lift * within, within)[:2]
    distance = lift + np.where(triangle < 0, 0, distance)[:, None]
    normal, leaves, far = surface(scene, triangle, point + distance * within, within)
    is_plate = (triangle >= 0) & leaves & is_glass(far, leaves) & (dot(entry, normal) > PARALLEL)
    mirrored = fresnel(-dot(within, normal), 1 / near[:, IOR].clip(LEAST_IOR))[:, None]
    tint = tint_of_surface(near, ~leaves) * tint_of_surface(far, leaves)
    gain[rows] += is_plate[:, None] * tint * (1 - mirrored) / (1 + mirrored)
    return gain
