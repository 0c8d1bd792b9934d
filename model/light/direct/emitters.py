# SPDX-License-Identifier: GPL-3.0-or-later
"""Gather light triangles into a few emitters whose unshadowed light has a closed form."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry import area_vectors, surfaces
from ...scene import RenderScene
from .emitter_clusters import Emitters, merged, triangle
from .outlines import convex_outline

DISTANT = 15.0      # network units; an open surface beyond is a sun, which looks alike from everywhere
MAX_EMITTERS = 96   # of a scene, as many as eight disk lamps: time and memory of direct light grow with them
MAX_POLYGONS = 16   # triangles of one connected emitter that are kept one by one
MAX_LUMPS = 8       # what a larger one is merged into
CLOSED = 0.3        # |vector area| / area below which a surface radiates like a sphere
FLAT = 1.5          # silhouette over that of a sphere of equal area from which on it radiates like a sheet; 2 at most


class Limits(NamedTuple):
    """Of the light of K kinds of emitters."""

    hidden: np.ndarray   # (K,) u8, rays that do not see them
    bounces: np.ndarray  # (K,) u8, most of its bounces
    groups: np.ndarray   # (K,) u64, of surfaces that it falls on
    blockers: np.ndarray  # (K,) u64, groups of surfaces that stop it
    is_lamp: np.ndarray  # (K,) bool, that no camera sees them: all others hide none of their light from each other

    @classmethod
    def of(cls, scene: RenderScene) -> tuple[Limits, np.ndarray]:
        """And the kind (L,) of each triangle that shines."""
        each = cls(scene.hidden_from, *map(scene.seldom, ("light_bounces", "lit_groups", "blockers")), ~scene.is_seen)
        table = np.stack([values[scene.is_light].astype(np.uint64) for values in each], axis=1)
        rows, kind = np.unique(table, axis=0, return_inverse=True)
        return cls(*rows.T), kind.reshape(-1)


def gather_emitters(scene: RenderScene) -> Emitters:
    """Touching light triangles of equal radiance and beam as one: flat convex ones a polygon, lamps spheres, fine
    meshes a few lumps.

    A scene with more than MAX_EMITTERS of these, such as an emission texture makes, gets that many, and as much light.
    """
    rows = np.flatnonzero(scene.is_light)
    corners = scene.triangles[rows]
    kind = Limits.of(scene)[1][:, None]
    light = np.concatenate([scene.emission[rows], scene.beam_axis[rows], scene.beam_cosine[rows], kind], axis=1)
    emitters = _gathered(corners, light)
    if len(emitters) > MAX_EMITTERS:
        center, radius = _bounding_sphere(scene)
        emitters = _gathered(corners, _evened(corners, light, center))
        emitters = merged(emitters, MAX_EMITTERS, center, radius)
    return emitters


def _gathered(corners: np.ndarray, light: np.ndarray) -> Emitters:
    """Emitters of (N, 3, 3) triangles; light: (N, 9) radiance, beam axis, cosines, kind."""
    polygons, spheres = [], []
    for part in _components(corners, light):
        shape, own = corners[part], light[part[0]]
        vectors = area_vectors(shape)
        if not vectors.any():
            continue
        if np.linalg.norm(shape.mean(axis=(0, 1))) > DISTANT and not _is_closed(vectors):
            middle, area = shape.mean(axis=(0, 1)), np.linalg.norm(vectors.sum(axis=0)) / np.pi
            spheres.append((middle, np.sqrt(area / (1 + area / (middle @ middle))), own))  # of the same solid angle
        elif not _is_closed(vectors):
            polygons += [(piece, own) for piece in _pieces(shape)]
        elif (sheet := _sheet(shape, vectors.astype(np.float64))) is None:
            spheres.append((*_sphere(shape, vectors), own))
        else:
            front, gain = sheet
            polygons += [(piece, own * ([gain] * 3 + [1] * 6)) for piece in _pieces(front)]
    return Emitters.of(polygons, spheres)


def _is_closed(vectors: np.ndarray) -> bool:
    return np.linalg.norm(vectors.sum(axis=0)) < CLOSED * np.linalg.norm(vectors, axis=1).sum()


def _evened(corners: np.ndarray, light: np.ndarray, center: np.ndarray) -> np.ndarray:
    """`light` with the mean radiance on closed surfaces, so that these become spheres, unless `center` is inside."""
    light = light.copy()
    for part in _components(corners, light[:, 3:]):
        vectors = area_vectors(corners[part])
        if _is_closed(vectors):
            middle, radius = _sphere(corners[part], vectors)
            if np.linalg.norm(middle - center) > radius:
                light[part, :3] = np.average(light[part, :3], axis=0, weights=np.linalg.norm(vectors, axis=1))
    return light


def _bounding_sphere(scene: RenderScene) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of what is lit: the scene without its lights."""
    points = scene.triangles[~scene.is_light if not scene.is_light.all() else slice(None)].reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-20)


def _components(corners: np.ndarray, kinds: np.ndarray) -> list[np.ndarray]:
    """Rows of triangles that share a corner position and have equal `kinds` (N, K)."""
    group = surfaces(corners, kinds)
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1) if len(group) else []


def _pieces(shape: np.ndarray) -> list[np.ndarray]:
    """Corners of the polygons (K, 3) of an open surface (n, 3, 3): one if it is flat, else its triangles or lumps."""
    outline = convex_outline(shape)
    if outline is not None:
        return [outline]
    if len(shape) <= MAX_POLYGONS:
        return list(shape)
    centroids = shape.mean(axis=1)
    order = np.argsort(centroids[:, np.ptp(centroids, axis=0).argmax()])
    return [_lump(shape[rows]) for rows in np.array_split(order, MAX_LUMPS)]


def _lump(shape: np.ndarray) -> np.ndarray:
    vectors = area_vectors(shape)
    center = np.average(shape.mean(axis=1), axis=0, weights=np.linalg.norm(vectors, axis=1) + 1e-20)
    return triangle(vectors.sum(axis=0), center)


def _sphere(shape: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the sphere of the same area."""
    weights = np.linalg.norm(vectors, axis=1)
    return np.average(shape.mean(axis=1), axis=0, weights=weights), float(np.sqrt(weights.sum() / (4 * np.pi)))


def _sheet(shape: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Half of a flat closed surface, moved into its middle, and the gain with which it gives the light of the whole.

    None if the surface is not flat.
    """
    areas = np.linalg.norm(vectors, axis=1)
    _, axes = np.linalg.eigh(vectors.T @ (vectors / np.maximum(areas, 1e-30)[:, None]))
    axis = axes[:, -1]
    silhouette = np.abs(vectors @ axis).sum() / 2
    if silhouette < FLAT * areas.sum() / 4:
        return None
    front = vectors @ axis > 0.5 * areas
    heights = shape.mean(axis=1) @ axis
    sink = np.average(heights[front], weights=areas[front]) - np.average(heights, weights=areas)
    return shape[front] - (sink * axis).astype(np.float32), areas.sum() / (2 * areas[front].sum())
