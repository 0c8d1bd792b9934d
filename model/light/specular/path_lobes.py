# SPDX-License-Identifier: GPL-3.0-or-later
"""Lobes of what specular paths meet, which show lamps and surroundings as a mean: metal, layers, glass that is left."""
from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...geometry import LEAST_IOR, dot, reflected
from ...material.reflectance import LEAST_LAYER, fresnel, layer_reflectance, widened
from ...scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene
from ...shading import surface
from . import facets
from .glass import PURE, TURBID, Cast, tint_of_surface

LIFT = 1e-4        # of the longest segment so far, that a ray starts off its surface
ROUNDING = 2 * float(np.finfo(np.float32).eps)  # of coordinates, by which points may lie off their surface
LEAST_BLUR = 0.03  # roughness of smooth surfaces in which lamps are mirrored


def first_reach(position: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """(P,) lengths of segments from an eye, (3,) or (P, 3), to points (P, 3), or longer ones, far from the world's
    origin, so that LIFT of them is more than coordinates are rounded by."""
    return np.maximum(np.linalg.norm(position - eye, axis=1), ROUNDING / LIFT * np.abs(position).max(axis=1))


@dataclass
class Lobe:
    """P points whose lobe shows lamps, and, but for polished metal and where glass is left, all that is around."""

    position: np.ndarray   # (P, 3) f32, world
    normal: np.ndarray     # (P, 3) f32, unit, of metal, facing the path; where glass is left, axis of the lobe
    color: np.ndarray      # (P, 3) f32; 0 = none
    roughness: np.ndarray  # (P, 1) f32
    f0: np.ndarray | float = 1.0  # (P, 1) f32, at normal incidence, of what it reflects at grazing angles
    viewer: np.ndarray | float = 0.0  # (P, 3) f32, unit, from where it is seen; 0 where that is the first hit

    @classmethod
    def none(cls, count: int) -> Lobe:
        """That of so many points, which have none."""
        return cls(*(np.zeros((count, channels), np.float32) for channels in (3, 3, 3, 1, 1, 3)))

    @classmethod
    def joined(cls, parts: list[Lobe]) -> Lobe:
        """Those of some points, then of others."""
        return cls(*map(np.concatenate, zip(*(vars(part).values() for part in parts), strict=True)))

    def set(self, rows: np.ndarray, lobe: Lobe) -> None:
        for own, other in zip(vars(self).values(), vars(lobe).values(), strict=True):
            own[rows] = other


class MetSurfaces(NamedTuple):
    """Surfaces that P paths meet."""

    triangle: np.ndarray   # (P,) i32, of the geometry
    point: np.ndarray      # (P, 3)
    direction: np.ndarray  # (P, 3) unit, of the paths
    tint: np.ndarray       # (P, 3) share of what the paths show that is seen
    normal: np.ndarray     # (P, 3) unit, facing the paths
    inside: np.ndarray     # (P,) bool, met from behind
    texel: np.ndarray      # (P, C) of their materials

    @classmethod
    def at(cls, scene: RenderScene, triangle: np.ndarray, point: np.ndarray, direction: np.ndarray,
           tint: np.ndarray) -> MetSurfaces:
        """Arguments as the fields."""
        return cls(triangle, point, direction, tint, *surface(scene, triangle, point, direction))

    def among(self, chosen: np.ndarray) -> MetSurfaces:
        return MetSurfaces(*(values[chosen] for values in self))


def metal_lobe(met: MetSurfaces) -> Lobe:
    """That of metal, untinted."""
    texel = met.texel
    mirrors = texel[:, METALLIC, None] > PURE
    return Lobe(met.point, met.normal, texel[:, BASE_COLOR] * mirrors, texel[:, ROUGHNESS, None])


def layer_lobe(met: MetSurfaces) -> Lobe:
    """The same of a dielectric layer, or of glass."""
    texel = met.texel
    f0 = layer_reflectance(texel[:, IOR, None], texel[:, TRANSMISSION, None])
    color = np.repeat((1 - texel[:, METALLIC, None]) * (f0 > LEAST_LAYER), 3, axis=1)
    return Lobe(met.point, met.normal, color, texel[:, ROUGHNESS, None].clip(LEAST_BLUR), f0)


def gloss_lobe(met: MetSurfaces) -> Lobe:
    """That of metal, and else of the layer, in the tint of the paths."""
    metal, layer = metal_lobe(met), layer_lobe(met)
    mirrors = metal.color.any(1, keepdims=True)
    color, roughness, f0 = (np.where(mirrors, *kinds) for kinds in (
        (metal.color, layer.color), (metal.roughness, layer.roughness), (1, layer.f0)))
    return Lobe(met.point, met.normal, met.tint * color, roughness, f0, -met.direction)


def exit_lobe(met: MetSurfaces, leaves: np.ndarray, tint: np.ndarray, least: float = facets.LEAST_ROUGHNESS) -> Lobe:
    """That of paths which leave glass (P,), of a tint (P, 3) then."""
    texel = met.texel
    axis, roughness, share = facets.exit_lobe(met.direction, met.normal, texel[:, ROUGHNESS], texel[:, IOR].clip(1),
                                              least)
    share = leaves * share * np.maximum(texel[:, TRANSMISSION], TURBID)
    return Lobe(met.point, axis, tint * share[:, None], roughness[:, None])


def inner_lobe(scene: RenderScene, cast: Cast, met: MetSurfaces, reach: np.ndarray) -> Lobe:
    """The same where paths that are reflected inside of glass leave it next; reach: as of Paths."""
    first, direction = met.texel, reflected(met.direction, met.normal)
    mirrors = first[:, METALLIC, None] * first[:, BASE_COLOR]
    inner = fresnel(-dot(met.direction, met.normal), 1 / first[:, IOR].clip(LEAST_IOR))[:, None]
    origin = met.point + LIFT * reach[:, None] * direction
    triangle, distance = cast(origin, direction)[:2]
    point = origin + np.where(triangle < 0, 0, distance)[:, None] * direction
    back = MetSurfaces.at(scene, triangle, point, direction, met.tint * (mirrors + (1 - mirrors) * inner))
    tint = back.tint * tint_of_surface(back.texel, back.inside)
    lobe = exit_lobe(back, back.inside & (triangle >= 0), tint, least=-1)
    roughness = widened(lobe.roughness, first[:, ROUGHNESS, None] ** 4)
    lobe.roughness = roughness.clip(LEAST_BLUR, 1).astype(np.float32)
    return lobe
