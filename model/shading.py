# SPDX-License-Identifier: GPL-3.0-or-later
"""What a ray finds on a triangle of a scene: its shading normal, its side and the parameters of its material."""
from __future__ import annotations

import numpy as np

from .geometry import area_vectors, barycentric, dot, facing
from .scene import RenderScene, texels


def surface(scene: RenderScene, triangle: np.ndarray, point: np.ndarray,
            direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The surface at world points (P, 3) on triangles (P,) that are met along unit directions (P, 3).

    Unit shading normals (P, 3) facing the viewer, whether they are met from behind (P,), and material texels (P, C).
    """
    corners = scene.triangles[triangle]
    weights = barycentric(corners, point).clip(0, 1).astype(np.float32)
    x, y = texels(weights[:, :2])
    texel = scene.tiles[scene.tile_index[triangle], :, y, x].astype(np.float32)
    normal = shading_normals(scene, triangle, weights, direction)
    return normal, dot(area_vectors(corners), direction) > 0, texel


def shading_normals(scene: RenderScene, triangle: np.ndarray, weights: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """(P, 3) f32 unit normals on triangles (P,) with weights (P, 3) of their corners, facing who looks along (P, 3)."""
    normal = np.einsum("pk,pkc->pc", weights, scene.normals[triangle])
    return facing(normal / np.sqrt(dot(normal, normal)).clip(1e-12)[:, None], ray)
