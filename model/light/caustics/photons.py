# SPDX-License-Identifier: GPL-3.0-or-later
"""Photons from emitters through glass to the surfaces where they end (Jensen 1996).

Cycles blurs glass that is seen from a matte surface (Filter Glossy), or no ray would find a lamp through it; so it is
blurred here.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch

from ...geometry import LEAST_IOR, area_vectors, dot, reflected, refracted, unit
from ...material.reflectance import blurred, fresnel, unmasked, visible_facets
from ...scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene, tint_of_glass
from ...scene_rays import RaysAmong, scene_rays
from ...shading import bent_to_reflect, side_normals, surface
from ...surface_kinds import BENDING, SOLID, Kind, Ray
from ..direct.direct_light import DirectLight
from ..direct.emitter_shadows import END_GAP
from ..sampling import R2, triangle_weights
from ..specular.glass import CLEAR, lost
from ..specular.path_lobes import LIFT

SURFACES = 8      # of glass that a photon passes at most
UNIFORM = 0.1     # share of all photons that is distributed by area alone


class Photons(NamedTuple):
    """N photons where they end, in network units; numpy arrays or tensors."""

    position: np.ndarray   # (N, 3) f32
    direction: np.ndarray  # (N, 3) f32, unit, in which they travelled
    normal: np.ndarray     # (N, 3) f32, unit, of the side that they hit
    flux: np.ndarray       # (N, 3) f32
    triangle: np.ndarray   # (N,) i32, of the geometry; -1 on glass, which may be matte too
    weights: np.ndarray    # (N, 2) f32, of that triangle's corners 0 and 1


def trace_photons(scene: RenderScene, direct: DirectLight, count: int) -> Photons:
    """Send `count` photons from emitters at the glass of a normalised scene; returns those that it has bent."""
    chance = np.random.default_rng(0).random((count, SURFACES + 1, 3), np.float32)  # each photon has its own
    rays, corners = scene_rays(scene), scene.surfaces.triangles
    glass, panes, landed = rays.rows(BENDING, Ray.DIFFUSE), rays.among(BENDING, Ray.DIFFUSE), []
    walls = rays.among(SOLID | Kind.EMITTER, Ray.TRANSMISSION)
    group = scene.seldom("group")[scene.surfaces.token[glass]]
    number, row, at, ray, flux = _emit(corners[glass], group, direct, panes, chance[:, 0, :2])
    row, shines = glass[row], np.append(scene.is_light[scene.surfaces.token], True)
    is_milky = (scene.tiles[:, TRANSMISSION].mean(axis=(1, 2)) <= CLEAR)[scene.tile_index][scene.surfaces.token]
    for k in range(1, SURFACES + 1):
        if k > 1:
            stays = is_milky[row]
            landed.append(Photons(at[stays], ray[stays], side_normals(scene, row[stays], ray[stays]), flux[stays],
                                  np.full(stays.sum(), -1, np.int32), np.zeros((stays.sum(), 2), np.float32)))
        before = at - LIFT * ray  # from here a photon hits what touches the glass
        ray, tint = _bend(scene, row, at, ray, chance[number, k])
        flux = flux * tint
        at = at + LIFT * ray
        pane, wall = panes.closest(at, ray), walls.closest(before, ray)
        if direct.fog is not None:
            flux = flux * direct.fog.along(at, ray, np.minimum(wall.distance, pane.distance))
        wall_first = wall.distance < pane.distance
        ends = wall_first & ~shines[wall.triangle] & flux.any(1)
        triangle = wall.triangle[ends]
        landed.append(Photons(before[ends] + wall.distance[ends, None] * ray[ends], ray[ends],
                              side_normals(scene, triangle, ray[ends]), flux[ends], triangle, wall.weights[ends]))
        goes_on = (pane.triangle >= 0) & ~wall_first & flux.any(1)
        number, ray, flux, row = number[goes_on], ray[goes_on], flux[goes_on], pane.triangle[goes_on]
        at = at[goes_on] + pane.distance[goes_on, None] * ray
    return Photons(*map(np.concatenate, zip(*landed, strict=True)))


def lit_surfaces(scene: RenderScene) -> np.ndarray:
    """(L, 3, 3) triangles that photons end on, and glass, most of which is dark."""
    rays = scene_rays(scene)
    return scene.surfaces.triangles[np.append(rays.rows(SOLID, Ray.TRANSMISSION), rays.rows(BENDING, Ray.DIFFUSE))]


def _emit(corners: np.ndarray, group: np.ndarray, direct: DirectLight, panes: RaysAmong,
          chance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The M of N photons, one for each row of chance (N, 2), that reach glass without a hit before.

    group: (L,) of surfaces, of the glass. Returns the numbers of photons (M,), the triangle (M,) and point (M, 3) that
    they hit, their unit direction (M, 3) and flux (M, 3).
    """
    count, vectors = len(chance), area_vectors(corners)
    normal, area = unit(vectors), np.linalg.norm(vectors, axis=1)
    _, light = _sample_emitters(direct, group, corners.mean(axis=1), normal, np.zeros((len(area), 2), np.float32))
    power = area * light.mean(axis=1)
    share = UNIFORM * area / area.sum() + (1 - UNIFORM) * power / max(power.sum(), 1e-30)
    row = np.searchsorted(share.cumsum(), (np.arange(count) + 0.5) / count * share.sum()).clip(max=len(area) - 1)
    u, v = (torch.from_numpy(np.float32(np.arange(count) * step % 1)) for step in R2)
    point = np.einsum("nk,nkc->nc", triangle_weights(u, v).numpy(), corners[row])
    to_emitter, light = _sample_emitters(direct, group[row], point, normal[row], chance)
    distance = np.linalg.norm(to_emitter, axis=1)
    direction = to_emitter / distance.clip(1e-9)[:, None]
    flux = light * (math.pi * area[row] / (count * share[row]))[:, None]
    shadow_ray = point + LIFT * direction, direction, (distance - END_GAP).clip(0)
    number = np.flatnonzero(flux.any(1) & ~panes.blocked(*shadow_ray) & ~direct.occluders.rays.blocked(*shadow_ray))
    return number, row[number], point[number], -direction[number], flux[number].astype(np.float32)


def _sample_emitters(direct: DirectLight, group: np.ndarray, *arrays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As DirectLight.sample_emitters, of the light that falls on groups (N,) of surfaces."""
    like, result = direct.emitters.radiance, np.zeros((2, len(group), 3), np.float32)
    for number in np.unique(group).tolist():
        rows = np.flatnonzero(group == number)
        some = direct.reaching(number).sample_emitters(*(torch.from_numpy(a[rows]).to(like) for a in arrays))
        result[:, rows] = torch.stack(some).cpu().numpy()
    return result[0], result[1]


def _bend(scene: RenderScene, row: np.ndarray, at: np.ndarray, ray: np.ndarray,
          chance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (N, 3) in which photons go on that hit glass along unit rays (N, 3), and their tint (N, 3).

    Reflected with the probability of the reflectance by Fresnel and of metal, else refracted; chance: (N, 3).
    """
    normal, inside, texel = surface(scene, row, at, ray)
    side = side_normals(scene, row, ray)
    normal = bent_to_reflect(normal, side, ray)
    ior, alpha = texel[:, IOR].clip(LEAST_IOR), blurred(texel[:, ROUGHNESS]) ** 2
    facet = visible_facets(normal, ray, alpha, chance[:, :2])
    share, metallic = fresnel(-dot(ray, facet), np.where(inside, 1 / ior, ior)), texel[:, METALLIC]
    mirrors = metallic + (1 - metallic) * share
    is_reflected = chance[:, 2] < mirrors
    out = unit(np.where(is_reflected[:, None], reflected(ray, facet), refracted(ray, facet, ior, inside)))
    passes = unmasked(dot(ray, normal), dot(out, normal), alpha) * ~lost(out, facet, side)
    metal = (metallic / np.maximum(mirrors, 1e-9))[:, None]  # of what is reflected
    tint = np.where(is_reflected[:, None], 1 - metal + metal * texel[:, BASE_COLOR],
                    texel[:, TRANSMISSION, None] * tint_of_glass(texel[:, BASE_COLOR]))
    # In Cycles radiance stays as it is where a ray is bent, though rays into glass come closer together.
    gain = np.where(is_reflected, 1, np.where(inside, ior, 1 / ior) ** 2)
    return out, ((passes * gain)[:, None] * tint).astype(np.float32)
