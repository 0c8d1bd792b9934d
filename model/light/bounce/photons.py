# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of lamps that glass bends, as photons on the surfaces where they end (Jensen 1996).

Cycles blurs glass that is seen from a matte surface (Filter Glossy), or no ray would find a lamp through it; so is it
blurred here.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch

from ...geometry import area_vectors, dot, facing, reflected, refracted, unit
from ...material.reflectance import blurred, fresnel, unmasked, visible_facets
from ...rays import Rays
from ...scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene, tint_of_glass
from ...shading import surface
from ..direct.direct_light import BEFORE, LightPrior
from ..sampling import R2, triangle_weights
from ..specular_paths import CLEAR, LIFTED

SURFACES = 8      # of glass that a photon passes at most
EVENLY = 0.1      # of all photons, how many go by area alone


class Photons(NamedTuple):
    """N photons where they end, in network units."""

    position: np.ndarray   # (N, 3) f32
    direction: np.ndarray  # (N, 3) f32, unit, in which they came
    normal: np.ndarray     # (N, 3) f32, unit, of the side that they are on
    flux: np.ndarray       # (N, 3) f32
    triangle: np.ndarray   # (N,) i32, of the solid ones; -1 on glass, which may be matte too


def photons(scene: RenderScene, prior: LightPrior, glass: np.ndarray, solid: np.ndarray, walls: Rays,
            count: int) -> Photons:
    """Those of `count` that lamps send at the triangles `glass` (T,) of a normalised scene, where they have been bent.

    solid: (S, 3, 3) corners of all that is no glass, walls: rays against these first, then against what ends photons.
    """
    chance = np.random.default_rng(0).random((count, SURFACES + 1, 3), np.float32)  # each photon has its own
    panes, found = Rays(scene.triangles[glass]), []
    number, row, at, ray, light = _sent(scene.triangles[glass], prior, panes, chance[:, 0, :2])
    row, milky = glass[row], (scene.tiles[:, TRANSMISSION].mean(axis=(1, 2)) <= CLEAR)[scene.tile_index]
    for k in range(1, SURFACES + 1):
        if k > 1:
            stay = milky[row]
            found.append(Photons(at[stay], ray[stay], _facing(scene.triangles[row[stay]], ray[stay]), light[stay],
                                 np.full(stay.sum(), -1, np.int32)))
        before = at - LIFTED * ray  # from here a photon meets what touches the glass
        ray, tint = _bent(scene, row, at, ray, chance[number, k])
        light = light * tint
        at = at + LIFTED * ray
        pane, wall = panes.closest(at, ray), walls.closest(before, ray)
        nearer = wall.distance < pane.distance
        ends = nearer & (wall.triangle < len(solid)) & light.any(1)
        met = wall.triangle[ends]
        found.append(Photons(before[ends] + wall.distance[ends, None] * ray[ends], ray[ends],
                             _facing(solid[met], ray[ends]), light[ends], met))
        on = (pane.triangle >= 0) & ~nearer & light.any(1)
        number, ray, light, row = number[on], ray[on], light[on], glass[pane.triangle[on]]
        at = at[on] + pane.distance[on, None] * ray
    return Photons(*map(np.concatenate, zip(*found, strict=True)))


def _sent(corners: np.ndarray, prior: LightPrior, panes: Rays,
          chance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of as many photons as rows of chance (N, 2), which ones reach glass (M,), and of these:

    the triangle (M,), the place (M, 3), the unit ray (M, 3) by which they reach it and their flux (M, 3).
    """
    count, vectors = len(chance), area_vectors(corners)
    normal, area = unit(vectors), np.linalg.norm(vectors, axis=1)
    _, light = _beamed(prior, corners.mean(axis=1), normal, np.zeros((len(area), 2), np.float32))
    power = area * light.mean(axis=1)
    share = EVENLY * area / area.sum() + (1 - EVENLY) * power / max(power.sum(), 1e-30)
    row = np.searchsorted(share.cumsum(), (np.arange(count) + 0.5) / count * share.sum()).clip(max=len(area) - 1)
    u, v = (torch.from_numpy(np.float32(np.arange(count) * step % 1)) for step in R2)
    origin = np.einsum("nk,nkc->nc", triangle_weights(u, v).numpy(), corners[row])
    way, light = _beamed(prior, origin, normal[row], chance)
    far = np.linalg.norm(way, axis=1)
    towards = way / far.clip(1e-9)[:, None]
    flux = light * (math.pi * area[row] / (count * share[row]))[:, None]
    given = origin + LIFTED * towards, towards, (far - BEFORE).clip(0)
    reach = np.flatnonzero(flux.any(1) & ~panes.blocked(*given) & ~prior.blockers.rays.blocked(*given))
    return reach, row[reach], origin[reach], -towards[reach], flux[reach].astype(np.float32)


def _beamed(prior: LightPrior, *arrays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return tuple(x.cpu().numpy() for x in prior.beamed(*(torch.from_numpy(a).to(prior.radiance) for a in arrays)))


def _bent(scene: RenderScene, row: np.ndarray, at: np.ndarray, ray: np.ndarray,
          chance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (N, 3) in which photons go on from glass that they met along unit rays (N, 3), and their tint.

    Either mirrored or refracted, as often as Fresnel says; chance: (N, 3).
    """
    normal, inside, texel = surface(scene, row, at, ray)
    ior, alpha = texel[:, IOR].clip(1), blurred(texel[:, ROUGHNESS]) ** 2
    facet = visible_facets(normal, ray, alpha, chance[:, :2])
    mirrors = chance[:, 2] < fresnel(-dot(ray, facet), np.where(inside, 1 / ior, ior))
    away = unit(np.where(mirrors[:, None], reflected(ray, facet), refracted(ray, facet, ior, inside)))
    before = dot(away, _facing(scene.triangles[row], ray)) > 0
    passes = unmasked(dot(ray, normal), dot(away, normal), alpha) * (before == mirrors)
    through = texel[:, TRANSMISSION] * (1 - texel[:, METALLIC])
    tint = np.where(mirrors[:, None], 1, through[:, None] * tint_of_glass(texel[:, BASE_COLOR]))
    return away, (passes[:, None] * tint).astype(np.float32)


def _facing(corners: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """(N, 3) unit normals of triangles (N, 3, 3), of the side that rays (N, 3) meet."""
    return facing(unit(area_vectors(corners)), ray)
