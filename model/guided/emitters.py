# SPDX-License-Identifier: GPL-3.0-or-later
"""Light triangles gathered into few emitters whose unshadowed light has a closed form."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import area_vectors
from ..scene import RenderScene

MAX_POLYGONS = 16   # triangles of one connected emitter that are kept one by one
MAX_LUMPS = 8       # what a larger one is merged into
CLOSED = 0.3        # |vector area| / area below which a surface radiates like a sphere


@dataclass
class Emitters:
    """P triangles and S spheres; radiance in the scene's units; a beam axis of zero length radiates everywhere."""

    corners: np.ndarray      # (P, 3, 3) f32
    centers: np.ndarray      # (S, 3) f32
    radii: np.ndarray        # (S,) f32
    radiance: np.ndarray     # (P + S, 3) f32
    beam_axis: np.ndarray    # (P + S, 3) f32
    beam_cosine: np.ndarray  # (P + S, 2) f32


def gather_emitters(scene: RenderScene) -> Emitters:
    """Merge touching light triangles of equal radiance and beam: lamps become spheres, fine meshes a few lumps."""
    rows = np.flatnonzero(scene.is_light)
    corners = scene.triangles[rows]
    beams = np.concatenate([scene.emission[rows], scene.beam_axis[rows], scene.beam_cosine[rows]], axis=1)
    polygons, spheres = [], []
    for part in _components(corners, beams):
        area_vector = area_vectors(corners[part])
        area = np.linalg.norm(area_vector, axis=1).sum()
        if area <= 0:
            continue
        if np.linalg.norm(area_vector.sum(axis=0)) < CLOSED * area:
            spheres.append((*_sphere(corners[part], area_vector), beams[part[0]]))
        elif len(part) <= MAX_POLYGONS:
            polygons += [(corners[i], beams[i]) for i in part]
        else:
            for lump in np.array_split(_along_longest_axis(corners, part), MAX_LUMPS):
                polygons.append((_triangle(corners[lump]), beams[lump[0]]))
    attributes = np.array([p[-1] for p in polygons] + [s[-1] for s in spheres], np.float32).reshape(-1, 8)
    return Emitters(
        corners=np.array([p[0] for p in polygons], np.float32).reshape(-1, 3, 3),
        centers=np.array([s[0] for s in spheres], np.float32).reshape(-1, 3),
        radii=np.array([s[1] for s in spheres], np.float32),
        radiance=attributes[:, :3], beam_axis=attributes[:, 3:6], beam_cosine=attributes[:, 6:])


def _components(corners: np.ndarray, beams: np.ndarray) -> list[np.ndarray]:
    """Rows of triangles that share a corner position and the same radiance and beam."""
    if not len(corners):
        return []
    _, kind = np.unique(beams, axis=0, return_inverse=True)
    keyed = np.concatenate([corners, np.broadcast_to(kind.reshape(-1, 1, 1), corners.shape[:2] + (1,))], axis=2)
    _, vertex = np.unique(keyed.reshape(-1, 4).round(6), axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    label = np.arange(vertex.max() + 1)
    while True:
        lowest = label[vertex].min(axis=1)
        updated = label.copy()
        np.minimum.at(updated, vertex.ravel(), np.repeat(lowest, 3))
        updated = updated[updated]
        if (updated == label).all():
            break
        label = updated
    group = label[vertex[:, 0]]
    return [np.flatnonzero(group == g) for g in np.unique(group)]


def _sphere(corners: np.ndarray, area_vector: np.ndarray) -> tuple[np.ndarray, float]:
    weights = np.linalg.norm(area_vector, axis=1)
    return np.average(corners.mean(axis=1), axis=0, weights=weights), float(np.sqrt(weights.sum() / (4 * np.pi)))


def _triangle(corners: np.ndarray) -> np.ndarray:
    """(3, 3) equilateral triangle with the vector area and centroid of many."""
    vectors = area_vectors(corners)
    total = vectors.sum(axis=0)
    area = np.linalg.norm(total)
    normal = total / max(area, 1e-20)
    center = np.average(corners.mean(axis=1), axis=0, weights=np.linalg.norm(vectors, axis=1) + 1e-20)
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    up = np.cross(normal, side)
    radius = np.sqrt(area * 4 / (3 * np.sqrt(3)))
    angles = 2 * np.pi * np.arange(3) / 3
    return center + radius * (np.cos(angles)[:, None] * side + np.sin(angles)[:, None] * up)


def _along_longest_axis(corners: np.ndarray, part: np.ndarray) -> np.ndarray:
    centroids = corners[part].mean(axis=1)
    return part[np.argsort(centroids[:, np.ptp(centroids, axis=0).argmax()])]
