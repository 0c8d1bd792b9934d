# SPDX-License-Identifier: GPL-3.0-or-later
"""What a ray finds on the real surfaces of a scene, or beyond: shading normal, side, material of the token; the sky."""
from __future__ import annotations

import numpy as np

from .geometry import (
    area_vectors,
    barycentric,
    corner_weights,
    dot,
    facing,
    interpolated,
    nearest_texels,
    reflected,
    unit,
)
from .scene import EMISSION_SIZE, RenderScene, texels

GRAZING = 0.02  # least cosine between the viewer and a normal that is bent
RISE, STEEPEST_RISE = 0.01, 0.9  # least cosine between a facet and a mirrored ray, and at most this share of its ray's


def surface(scene: RenderScene, triangle: np.ndarray, point: np.ndarray,
            direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The surface at points (P, 3) on triangles (P,) of the geometry that are met along unit directions (P, 3).

    Unit shading normals (P, 3) facing the viewer, whether they are met from behind (P,), and material texels (P, C).
    """
    surfaces = scene.surfaces
    corners, token = surfaces.triangles[triangle], surfaces.token[triangle]
    weights = barycentric(corners, point).clip(0, 1).astype(np.float32)
    on_token = weights if scene.geometry is None else _nearest_weights(scene.triangles[token], point)
    x, y = texels(on_token[:, :2])
    is_behind = dot(area_vectors(corners), direction) > 0
    texel = scene.tiles[scene.tiles_met(token, is_behind), :, y, x].astype(np.float32)
    return shading_normals(scene, triangle, weights, direction), is_behind, texel


def emission_share(scene: RenderScene, triangle: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(P, 3) emission or glow at points (P, 3) on triangles (P,) of the geometry, or -1, over the means of these."""
    share = np.ones((len(triangle), 3), np.float32)
    if scene.emission_tile is None:
        return share
    token = scene.surfaces.token[triangle]
    rows = np.flatnonzero((triangle >= 0) & (scene.emission_tile[token] >= 0))
    x, y = texels(_nearest_weights(scene.triangles[token[rows]], point[rows])[:, :2], EMISSION_SIZE)
    share[rows] = scene.emission_tiles[scene.emission_tile[token[rows]], :, y, x]
    return share


def shading_normals(scene: RenderScene, triangle: np.ndarray, weights: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """(P, 3) f32 unit normals on triangles (P,) of the geometry with weights (P, 3) of their corners, on the side that
    the viewer along (P, 3) sees.

    As in Cycles they are bent where they lean away from the viewer, unless corners have normals of both sides: where
    those of the other side prevail, nothing is lit.
    """
    surfaces = scene.surfaces
    side = area_vectors(surfaces.triangles[triangle])
    normal = unit(interpolated(weights, surfaces.normals[triangle]))
    normal = np.where(dot(side, ray)[:, None] > 0, -normal, normal)
    return bent_toward(normal, ray, dot(normal, side) * dot(side, ray) < 0).astype(np.float32)


def bent_toward(normal: np.ndarray, ray: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Unit normals (P, 3), those `where` (P,) they lean away from the viewer along (P, 3) bent until they do not."""
    away = np.where(where, dot(normal, ray) + GRAZING, 0).clip(0)
    return unit(normal - away[:, None] * ray)


def side_normals(scene: RenderScene, triangle: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """(P, 3) unit normals of triangles (P,) of the geometry, of the sides that are met along (P, 3)."""
    return facing(unit(area_vectors(scene.surfaces.triangles[triangle])), ray)


def bent_to_reflect(normal: np.ndarray, side: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Unit normals (P, 3), bent toward `side_normals` (P, 3) where rays (P, 3) mirrored at them would go below these.

    Cycles does so for gloss and glass.
    """
    across = unit(normal - dot(normal, side)[:, None] * side)
    x, z = -dot(ray, across), -dot(ray, side)  # toward the viewer
    rise = np.minimum(RISE, STEEPEST_RISE * z)
    angle = (np.arctan2(x, z) + np.arccos((rise / np.hypot(x, z).clip(1e-6)).clip(-1, 1)))[:, None] / 2
    bent = np.sin(angle) * across + np.cos(angle) * side
    return np.where((dot(reflected(ray, normal), side) < rise)[:, None], bent, normal).astype(np.float32)


def seen_sky(scene: RenderScene, direction: np.ndarray, ray: int | np.ndarray) -> np.ndarray:
    """(P, 3) f32 radiance of the environment along unit vectors (P, 3), as rays of a kind, all or (P,) Ray, see it."""
    light = np.zeros((len(direction), 3), np.float32)
    for rays, environment in scene.environments:
        seeing = np.broadcast_to(ray & rays != 0, len(direction))
        light[seeing] = nearest_texels(environment, direction[seeing])
    return light


def on_tokens(scene: RenderScene, triangle: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Token triangles (P,) i32 that stand for triangles (P,) of the geometry, and weights (P, 2) f32 of corners 0 and 1
    at their points nearest to those with weights (P, 2) in these."""
    if scene.geometry is None:
        return triangle, weights
    corners, token = scene.geometry.triangles[triangle], scene.geometry.token[triangle]
    point = interpolated(corner_weights(weights), corners)
    return token, _nearest_weights(scene.triangles[token], point)[:, :2]


def _nearest_weights(corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(P, 3) f32 weights of corners (P, 3, 3) at points in the triangle near to points (P, 3)."""
    return clipped(barycentric(corners, point))


def clipped(weights: np.ndarray) -> np.ndarray:
    """Barycentric weights (..., 3) f32, those of points beside triangles moved into these."""
    weights = weights.clip(0, 1)
    return (weights / weights.sum(axis=-1, keepdims=True)).astype(np.float32)
