# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials evaluated at the pixel instead of read from a texel of the token's tile."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from ..geometry import area_vectors, barycentric, dot, interpolated, unit
from ..scene import PARAMETERS, RenderScene, View
from ..shading import GRAZING, bent_toward

BLUR = 0.7      # pixels over which a material is averaged, about the width of a filter


class Appearance(NamedTuple):
    """Material and shading of P points."""

    is_known: np.ndarray  # (P,) bool; the rest is arbitrary elsewhere
    texel: np.ndarray     # (P, 7) f32, channels of TILE before the normal
    emission: np.ndarray  # (P, 3) f32, radiance
    normal: np.ndarray    # (P, 3) f32, unit, world

    @classmethod
    def empty(cls, normal: np.ndarray) -> Appearance:
        """Unknown materials at points with these normals (P, 3)."""
        return cls(np.zeros(len(normal), bool), np.zeros((len(normal), PARAMETERS.stop), np.float32),
                   np.zeros_like(normal), normal.copy())


class Materials(Protocol):
    """Materials that can be evaluated at any point of a scene's geometry."""

    def groups(self, triangle: np.ndarray) -> np.ndarray | None:
        """(P,) i32 number of the material of triangles (P,), -1 where the token's tile is exact, and for triangle -1;
        None if that is so everywhere."""

    def at(self, triangle: np.ndarray, weights: np.ndarray, normal: np.ndarray,
           steps: Callable[[np.ndarray], np.ndarray]) -> Appearance:
        """The appearance of points of triangles (P,) that belong to groups.

        weights: (P, 3) f32 of their corners. normal: (P, 3) unit shading normals, world, facing the camera.
        steps: of some points by number (Q,), by how much weights change along a row and a column of the picture over
        what is to be blurred, (Q, 2, 3) f32; to be called on any thread.
        """


def appearance(scene: RenderScene, materials: Materials, view: View, rays: np.ndarray, at: np.ndarray,
               triangle: np.ndarray, weights: np.ndarray, normal: np.ndarray) -> Appearance:
    """The appearance of pixels by number (P,), whose rays (H, W, 3) hit triangles (P,) that have groups.

    weights: (P, 3) of the corners; normal: (P, 3) shading normals facing the camera, as those of the result do.
    """
    ray, corners = rays.reshape(-1, 3)[at], scene.surfaces.triangles
    origin = view.camera_to_world[:3, 3]

    def steps(rows: np.ndarray) -> np.ndarray:
        shape, ahead = corners[triangle[rows]], ray[rows]
        distance = dot(interpolated(weights[rows], shape) - origin, ahead)
        return _steps(shape, ahead, distance, _turns(rays, at[rows]))

    result = materials.at(triangle, weights, normal, steps)
    return result._replace(normal=bent_toward(result.normal, ray, dot(normal, ray) < 0))


def _turns(rays: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(P, 2, 3) by how much rays (H, W, 3) differ along the row and the column at pixels by number (P,)."""
    height, width = rays.shape[:2]
    row, column = np.divmod(at, width)
    below, right = (row + 1).clip(max=height - 1), (column + 1).clip(max=width - 1)
    return np.stack([rays[row, right] - rays[row, (right - 1).clip(0)],
                     rays[below, column] - rays[(below - 1).clip(0), column]], axis=1)


def _steps(corners: np.ndarray, ray: np.ndarray, distance: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """(P, 2, 3) f32 steps of weights on triangles (P, 3, 3), as `Materials.at` has them.

    They are hit along ray (P, 3) at a distance (P,); turns (P, 2, 3): of the ray to the next pixels (Igehy 1999,
    "Tracing Ray Differentials").
    """
    normal = unit(area_vectors(corners))
    cosine = dot(ray, normal)
    cosine = np.where(cosine < 0, -1, 1) * np.abs(cosine).clip(GRAZING)
    along = (dot(turns, normal[:, None]) / cosine[:, None])[..., None] * ray[:, None]
    ways = (BLUR * distance)[:, None, None] * (turns - along)
    last = corners[:, None, 2].astype(np.float64)
    return (barycentric(corners[:, None], last + ways) - (0, 0, 1)).astype(np.float32)
