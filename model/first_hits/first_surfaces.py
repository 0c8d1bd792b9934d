# SPDX-License-Identifier: GPL-3.0-or-later
"""The surfaces of the geometry that camera rays meet first, where Cycles saw something."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..camera import view_rays_at
from ..geometry import barycentric, corner_weights, facing, interpolated, unit
from ..progress import part
from ..rays import Hits
from ..scene import RenderScene, View
from ..scene_rays import scene_rays
from ..shading import on_tokens, shading_normals
from ..surface_kinds import ALL, SEEN, Ray
from .camera_rays import FINDING

NearestTriangles = Callable[[np.ndarray, np.ndarray], np.ndarray]  # (N, 3, 3) triangles, (k, 3) points -> (k,) indices

# A pixel's ray belongs to the triangle that it hits if that hit lies within this fraction of the distance of what
# Cycles saw, or of so many pictures in a row there: orthographic cameras are far away. Decimated meshes and
# displacement pass; what Cycles' camera does not see (alpha cut-outs, hidden objects) fails, and the triangle nearest
# to what it saw is taken instead.
TOLERANCE = 0.01
PICTURES = 3
# Camera rays pass through lamps, which may hang just below a ceiling: a light that shows no emission must fit closely.
UNSEEN_LIGHT_TOLERANCE = 1e-4
FILL_RADIUS = 4      # pixels


class FirstSurfaces(NamedTuple):
    """The surfaces that P rays, or those of all pixels (H, W), meet first."""

    position: np.ndarray  # (P, 3) f32, world
    normal: np.ndarray    # (P, 3) f32, shading normal facing the viewer; 0 = nothing is met
    token: np.ndarray     # (P,) i32, the token triangle that stands for the surface; -1 = nothing is met
    weights: np.ndarray   # (P, 2) f32 of the token's corners 0 and 1

    @classmethod
    def empty(cls, position: np.ndarray) -> FirstSurfaces:
        """Without surfaces at positions (..., 3)."""
        shape = position.shape[:-1]
        return cls(position, np.zeros_like(position), np.full(shape, -1, np.int32), np.zeros((*shape, 2), np.float32))

    def set(self, rows, surfaces: FirstSurfaces) -> None:
        for own, other in zip(self, surfaces, strict=True):
            own[rows] = other

    def taken(self, source: np.ndarray) -> FirstSurfaces:
        """The surfaces of other pixels, by flat index (H, W)."""
        return FirstSurfaces(*(x.reshape(source.size, *x.shape[2:])[source] for x in self))

    @classmethod
    def of_hits(cls, scene: RenderScene, hits: Hits, eye: np.ndarray, rays: np.ndarray) -> FirstSurfaces:
        """Where rays (P, 3) from a point hit the geometry, all of them."""
        return cls(hits.distance[:, None] * rays + eye,
                   shading_normals(scene, hits.triangle, corner_weights(hits.weights), rays),
                   *on_tokens(scene, hits.triangle, hits.weights))


def find_first_surfaces(scene: RenderScene, view: View, target: np.ndarray, hit: np.ndarray, emits: np.ndarray,
                        nearest_triangles: NearestTriangles) -> FirstSurfaces:
    """Those of the S pixels of `hit` (H, W) at which Cycles saw points `target` (S, 3) that emit light (S,) or not.

    The first one on the pixel's ray; if what Cycles saw is not there, the first visible one; if it is not there either,
    the token triangle nearest to it.
    """
    eye, (rows, columns) = view.camera_to_world[:3, 3], np.nonzero(hit)
    rays = view_rays_at(view, columns + 0.5, rows + 0.5)[1]
    close = TOLERANCE * min(PICTURES * view.longer_side / view.focal.max(), 1)
    result, remaining = FirstSurfaces.empty(target.copy()), np.arange(len(target))
    with part(0.0, 0.5, FINDING):
        for kinds in (ALL, SEEN):
            hits = scene_rays(scene).among(kinds, Ray.CAMERA).closest(eye, rays[remaining])
            away = np.linalg.norm(hits.distance[:, None] * rays[remaining] + eye - target[remaining], axis=1)
            away /= np.linalg.norm(target[remaining] - eye, axis=1)
            token = scene.surfaces.token[hits.triangle]
            is_light = scene.is_light[token]
            tolerance = np.where(is_light & ~emits[remaining], UNSEEN_LIGHT_TOLERANCE, close)
            fits = (hits.triangle >= 0) & (away <= tolerance) & (is_light | scene.is_seen[token])
            fitting = remaining[fits]
            result.set(fitting, FirstSurfaces.of_hits(scene, Hits(*(x[fits] for x in hits)), eye, rays[fitting]))
            remaining = remaining[~fits]
            if not len(remaining) or scene.is_seen.all():
                break
    if len(remaining):
        with part(0.5, 1.0, FINDING):
            nearest = nearest_triangles(scene.triangles, target[remaining])
        weights = barycentric(scene.triangles[nearest], target[remaining]).astype(np.float32)
        normal = facing(unit(interpolated(weights.clip(0), scene.normals[nearest])), rays[remaining])
        result.set(remaining, FirstSurfaces(target[remaining], normal, nearest, weights[:, :2].clip(0, 1)))
    return result


def nearest_pixels(known: np.ndarray, needed: np.ndarray) -> np.ndarray:
    """(H, W) flat index of the pixel itself, or of a nearby `known` one for pixels that are `needed` but not known."""
    height, width = known.shape
    source = np.arange(height * width).reshape(height, width)
    known = known.copy()
    for _ in range(FILL_RADIUS):
        rows, columns = np.nonzero(needed & ~known)
        if not len(rows):
            break
        for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            y, x = (rows + dy).clip(0, height - 1), (columns + dx).clip(0, width - 1)
            is_known = known[y, x]
            source[rows[is_known], columns[is_known]] = source[y[is_known], x[is_known]]
        known[rows, columns] = source[rows, columns] != rows * width + columns
    return source
