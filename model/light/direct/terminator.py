# SPDX-License-Identifier: GPL-3.0-or-later
"""Where shadow rays start on smooth surfaces: on the curved surface that the shading normals describe.

A lamp below the plane of a face, but above its shading normal, lights it in Cycles, because shadow rays start off the
face there (Hanika 2021, "Hacking the shadow terminator"; Blender's Shadow Terminator Geometry Offset, 0.1 by default).
"""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ...scene import RenderScene
from ...scene_rays import scene_rays
from ...surface_kinds import SOLID, Ray
from ..hit_surfaces import HitSurfaces
from ..tensor_rays import TensorRays
from ..vectors import dot, length
from .form_factors import cosines

LEAST = 0.1  # cosine of the light to face and normal, below which rays start higher
LOW = 2e-3   # network units: curved surfaces that are no higher above their faces are flat
PIECE = 1 << 16  # triangles at a time
APART = 0.02  # of the distance to the viewer, from a pixel's position to the face that a ray through its middle hits


def edge_heights(corners: Tensor, normals: Tensor) -> Tensor:
    """(N, 3) of the edges from corners 0, 1 and 2 to the next, for triangles and their normals (N, 3, 3)."""
    edges, turns = (x.roll(-1, 1) - x for x in (corners, normals))
    return (edges * turns).sum(-1)


def heights(of_edges: Tensor, weights: Tensor) -> Tensor:
    """(N, ...) of the curved surface above triangles (N, ..., 3) at weights (N, ..., 3) of their corners.

    A parabola along each edge.
    """
    return (of_edges * weights * weights.roll(-1, -1)).sum(-1)


def start_heights(direction: Tensor, face: Tensor, normal: Tensor) -> Tensor:
    """(P, E) share of the height at which rays along unit vectors (3, P, E) start, by unit normals (P, 3)."""
    to_face, to_normal = cosines(direction, face), cosines(direction, normal)
    grazing = torch.where(to_normal < LEAST, 2 - (to_face + to_normal) / LEAST, 1 - to_face / LEAST)
    return grazing.clamp(0, 1)


class CurvedFaces:
    """The faces of a scene that stand for curved surfaces."""

    def __init__(self, scene: RenderScene, device: torch.device):
        self._rays = TensorRays(scene_rays(scene).among(SOLID, Ray.CAMERA))
        self._corners, self._normals = (torch.from_numpy(x).to(device) for x in (
            scene.surfaces.triangles, scene.surfaces.normals))

    @classmethod
    def of(cls, scene: RenderScene, device: torch.device) -> CurvedFaces | None:
        """None if all are as good as flat."""
        surfaces = (torch.from_numpy(x).split(PIECE) for x in (scene.surfaces.triangles, scene.surfaces.normals))
        is_curved = any((edge_heights(*some) > 4 * LOW).any() for some in zip(*surfaces, strict=True))
        return cls(scene, device) if is_curved else None

    def at(self, surfaces: HitSurfaces) -> Tensor:
        """(h, W, 6) unit normals of faces at pixels, and the way up from there; 0 where there is nothing to climb."""
        shown = surfaces.is_covered[..., 0].nonzero().unbind(1)
        result = torch.zeros(*surfaces.roughness.shape, 6, device=surfaces.position.device)
        origin, ray, position = (x.expand_as(surfaces.position)[shown] for x in (
            surfaces.origin, surfaces.rays, surfaces.position))
        hits = self._rays.nearest(origin, ray)
        triangle, distance = hits.triangle.clamp_min(0), hits.distance[:, None]
        weights = torch.cat([hits.weights, 1 - hits.weights.sum(1, keepdim=True)], 1)
        corners, normals = self._corners[triangle], self._normals[triangle]
        face = F.normalize(torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), dim=-1)
        height = heights(edge_heights(corners, normals), weights).clamp_min(0)
        normal = F.normalize((weights[..., None] * normals).sum(1), dim=-1)
        is_there = length(origin + distance * ray - position) < APART * distance[:, 0]
        is_there &= (hits.triangle >= 0) & (dot(face, ray) < 0)
        result[shown] = torch.cat([face, (height * is_there)[:, None] * normal], 1)
        return result
