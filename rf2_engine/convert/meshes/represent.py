# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the token triangles that stand for the triangles of a mesh before it was simplified."""
from __future__ import annotations

import math

import numpy as np

from ....model import progress
from ....model.clusters import cell_index, facing_side, group_key, groups_of
from ....model.geometry import area_vectors, quartered, unit
from ....model.rays import Rays
from ..data import mesh as meshes
from ..data.mesh import TriangleMesh
from .nearest import NearestTriangles
from .reduce import weld

FACING = 0.3     # least cosine between the normals of a triangle and of the token that stands for it
REACH = 0.05     # extents of the mesh: largest distance between them
LARGER = 1.5     # longest edges of its token, from which on a triangle with a texture is quartered
ROUNDS = 6       # of quartering, at most
MOST = 1 << 16   # triangles that quartering adds, about
MANY = 100_000   # triangles; of more, those in one cell share a search
CELLS = 64       # in the area of a token
BEFORE = 1e-5    # extents of the mesh: a ray starts so far before its triangle, because its token may lie on it


def represent(mesh: TriangleMesh, tokens: TriangleMesh, is_textured: bool) -> tuple[TriangleMesh, np.ndarray]:
    """The mesh, and (n,) i32 rows of the tokens that stand for its triangles.

    Textured triangles are quartered until none is much larger than its token, whose tile holds the texture.
    """
    token, longest = _nearest(mesh, tokens), meshes.longest_edges(tokens.corners)
    for _ in range(ROUNDS if is_textured else 0):
        large = meshes.longest_edges(mesh.corners) > LARGER * longest[token]
        if not large.any() or 3 * np.count_nonzero(large) > MOST:
            break
        rest, pieces = mesh.take(~large), mesh.take(large)
        pieces = pieces.mapped(quartered, slot=np.tile(pieces.slot, 4))
        token = np.concatenate([token[~large], _nearest(pieces, tokens)])
        mesh = meshes.joined([rest, pieces])
    return mesh, token


def _nearest(mesh: TriangleMesh, tokens: TriangleMesh) -> np.ndarray:
    """(n,) i32 nearest token of the same material, or of any if none is left of it."""
    token = np.empty(len(mesh), np.int32)
    for slot in np.unique(mesh.slot):
        rows, candidates = np.flatnonzero(mesh.slot == slot), np.flatnonzero(tokens.slot == slot)
        candidates = candidates if len(candidates) else np.arange(len(tokens))
        token[rows] = candidates[_nearest_triangles(mesh.corners[rows], tokens.corners[candidates])]
    return token


def _nearest_triangles(corners: np.ndarray, tokens: np.ndarray) -> np.ndarray:
    """(n,) tokens that rays along the normals of triangles hit, from their middles to both sides, else the nearest.

    Of more than MANY triangles, those in one cell with similar normals share a token.
    """
    middle, vector = meshes.middles(corners), area_vectors(corners)
    if len(corners) <= MANY:
        return _met_or_nearest(middle, unit(vector), tokens)
    side = math.sqrt(float(meshes.areas(tokens).sum()) / (CELLS * len(tokens)))
    group, largest = groups_of(group_key(facing_side(vector), *cell_index(middle, side)), meshes.lengths(vector))
    return _met_or_nearest(middle[largest], unit(vector[largest]), tokens)[group]


def _met_or_nearest(middle: np.ndarray, normal: np.ndarray, tokens: np.ndarray) -> np.ndarray:
    """`_nearest_triangles` of triangles with these middles and unit normals (n, 3)."""
    progress.report()
    origin = tokens.reshape(-1, 3).mean(axis=0)
    extent = float(np.linalg.norm(np.ptp(tokens.reshape(-1, 3), axis=0)))
    reach, start = REACH * extent, BEFORE * extent
    facing, rays = meshes.face_normals(tokens), Rays(tokens - origin)
    best, nearest = np.full(len(middle), reach), np.full(len(middle), -1)
    for side in (1, -1):
        progress.report()
        hits = rays.closest(middle - origin - start * side * normal, side * normal)
        fits = (hits.triangle >= 0) & (hits.distance < best)
        fits &= np.einsum("nc,nc->n", facing[hits.triangle], normal) > FACING
        best[fits], nearest[fits] = hits.distance[fits], hits.triangle[fits]
    missed = np.flatnonzero(nearest < 0)
    if len(missed):
        nearest[missed] = NearestTriangles(*weld(tokens)).nearest(middle[missed].astype(np.float64))
    return nearest
