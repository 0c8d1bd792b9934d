# SPDX-License-Identifier: GPL-3.0-or-later
"""Fewer triangles for meshes that do not fit the token budget, by QSlim (docs/scene-input.md 2.3)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....model import progress
from ....model.geometry import barycentric
from ..data import mesh as meshes
from ..data.mesh import TriangleMesh
from .nearest import NearestTriangles
from .qslim import MANY, reduce_points, without_detail
from .sampling import thin_pieces

COARSEST = 8            # no mesh is simplified further, unless it has fewer triangles to begin with
KEPT_WHOLE = 64         # a mesh this small keeps all its triangles as long as the budget allows
ALIGNED = 0.7           # cosine between the normals of a triangle and of the fin that it approximates, at least
SEAMS = 0.1             # largest share of the edges at UV seams that is preserved


def simplify(mesh: TriangleMesh, target: int, space=None) -> TriangleMesh:
    """At most `target` triangles of about the same shape.

    space: the ApparentSpace in which shapes are compared; the frame of the object if None.
    Normals, UVs, colours and material slots come from the nearest original triangle.
    """
    if len(mesh) <= target:
        return mesh
    progress.report(0.0)
    mesh, points, faces = _thinned(mesh, target, space)
    if len(mesh) <= target:
        return mesh
    with progress.part(0.05, 0.15):
        points, faces, owner = _with_fins(points, faces, mesh)
    with progress.part(0.15, 0.3):
        surface = NearestTriangles(points, faces)
    progress.report(0.3)
    apparent = points if space is None else space.enter(points)
    with progress.part(0.35, 0.6):
        corners = reduce_points(apparent, faces, target)
    progress.report(0.6)
    if space is not None:
        corners = space.leave(corners)
    corners = corners.reshape(-1, 3, 3).astype(np.float32)
    corners = corners[meshes.within_reach(corners)]
    corners = corners[meshes.has_area(corners)]
    with progress.part(0.6, 0.95):
        progress.report(0.0)
        nearest = _nearest(corners, surface)
    progress.report(0.95)
    centre = nearest[:, 3]
    aligned = np.abs((meshes.face_normals(points[faces[centre]]) * meshes.face_normals(corners)).sum(axis=1))
    fin = (centre >= len(mesh)) & (aligned > ALIGNED)
    # Separate pieces are never merged: if that leaves too many triangles, the largest are kept.
    rows = np.argsort(np.where(fin, 0, -meshes.areas(corners)), kind="stable")[:min(target, np.count_nonzero(~fin))]
    if len(rows) == 0:
        return mesh.take(np.argsort(-meshes.areas(mesh.corners), kind="stable")[:target])
    rows.sort()
    return _with_attributes(corners[rows], mesh, owner[nearest[rows]])


def _thinned(mesh: TriangleMesh, target: int, space) -> tuple[TriangleMesh, np.ndarray, np.ndarray]:
    """The mesh without pieces and detail that are far too small for `target` triangles, and its points and faces as of
    `weld`."""
    points, faces = weld(mesh.corners)
    thinned = thin_pieces(mesh, points, faces, target, space)
    if thinned is not mesh:
        mesh, (points, faces) = thinned, weld(thinned.corners)
    if len(mesh) > MANY * target:
        chosen, faces, rows = without_detail(points if space is None else space.enter(points), faces, target)
        mesh, points = mesh.take(rows), points[chosen]
    return mesh, points, faces


def weld(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shared (v, 3) f32 points and (n, 3) i32 faces of (n, 3, 3) corners; those with equal coordinates are one."""
    flat, key = corners.reshape(-1, 3).astype(np.float32), meshes.corner_keys(corners).ravel()
    order = np.argsort(key)
    begins = np.insert(np.diff(key[order]) != 0, 0, True)
    faces = np.empty(len(key), np.int32)
    faces[order] = np.cumsum(begins) - 1
    return flat[order[begins]], faces.reshape(-1, 3)


def _with_fins(points: np.ndarray, faces: np.ndarray, mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and faces with an upright triangle on every edge where the mesh or a material ends or UVs are cut, and
    (n,) the faces that these belong to.

    QSlim alone sees no error in cutting the corners off a flat wall; fins keep such edges in place.
    """
    progress.report(0.0)
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    turned = edges[:, 0] > edges[:, 1]
    low, high = np.minimum(*edges.T).astype(np.int64), np.maximum(*edges.T)
    key = (low * len(points) + high) * (int(mesh.slot.max()) + 1) + np.repeat(mesh.slot, 3)
    progress.report(0.3)
    ends = _occurring_once(key)
    for i, layer in enumerate(mesh.uv.values()):
        progress.report(0.5 + 0.4 * i / len(mesh.uv))
        cut = _with_uv(key, layer, turned)
        progress.report(0.5 + 0.4 * (i + 0.5) / len(mesh.uv))
        seams = _occurring_once(cut)
        if len(seams) < SEAMS * len(edges):  # else there is an island for every few triangles
            ends = np.union1d(ends, seams)
    progress.report(0.9)
    start, end = points[edges[ends]].transpose(1, 0, 2)
    height = meshes.lengths(end - start)[:, None]
    tips = (start + end) / 2 + height * meshes.face_normals(points[faces[ends // 3]])
    fins = np.column_stack([edges[ends, ::-1], len(points) + np.arange(len(ends))])
    return (np.concatenate([points, tips]).astype(np.float64), np.concatenate([faces, fins]).astype(np.int32),
            np.concatenate([np.arange(len(faces)), ends // 3]))


def _occurring_once(key: np.ndarray) -> np.ndarray:
    """Indices of the values that occur once among (n,) i64."""
    ordered = np.sort(key)  # takes a sixth of the time of argsort
    begins = np.append(np.insert(ordered[1:] != ordered[:-1], 0, True), True)
    once = ordered[begins[:-1] & begins[1:]]
    if len(once) == 0:
        return np.zeros(0, np.int64)
    likely = np.zeros(1 << 16, bool)
    likely[_hash_key(once)] = True
    candidates = np.flatnonzero(likely[_hash_key(key)])
    return candidates[once[np.searchsorted(once, key[candidates]).clip(max=len(once) - 1)] == key[candidates]]


def _hash_key(key: np.ndarray) -> np.ndarray:
    """(n,) u64 below 2^16, alike for equal keys (Knuth's multiplicative hashing)."""
    return key.view(np.uint64) * np.uint64(0x9E3779B97F4A7C15) >> np.uint64(48)


def _with_uv(key: np.ndarray, layer: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """Keys (3 n,) of edges that differ where the UVs (n, 3, 2) at their ends do."""
    uv = np.round(np.nan_to_num(layer) * 65536).astype(np.int64) @ (1, 0x9E3779B1)
    ends = np.stack([uv, np.roll(uv, -1, axis=1)], axis=-1).reshape(-1, 2)
    ends = np.where(turned[:, None], ends[:, ::-1], ends)
    return key * 0x2545F4914F6CDD1D + ends @ (0x1D8E4E27C47D124F, 0x369DEA0F31A53F85)


def _nearest(corners: np.ndarray, surface: NearestTriangles) -> np.ndarray:
    """(m, 4) i64: the triangle of `surface` nearest to the three corners and the centre of each of (m, 3, 3)."""
    centre = corners.mean(axis=1, keepdims=True)
    # Corners are looked up a little inside their triangle: at a crease or seam they belong to its side.
    points = np.concatenate([0.95 * corners + 0.05 * centre, centre], axis=1)
    return surface.nearest(points.reshape(-1, 3).astype(np.float64)).reshape(-1, 4)


def _with_attributes(corners: np.ndarray, source: TriangleMesh, nearest: np.ndarray) -> TriangleMesh:
    """New (m, 3, 3) corners with the normals, UVs, colours and slots of the surface they approximate.

    nearest: (m, 4) triangles of `source` at the corners and the centre.
    """
    at_corner, at_centre = nearest[:, :3], nearest[:, 3]
    weights = np.clip(barycentric(source.corners[at_corner], corners), -2, 3)  # a sliver would throw it far off
    clamped = np.clip(weights, 0, None)
    clamped /= clamped.sum(axis=-1, keepdims=True)
    normals = np.einsum("mck,mckx->mcx", clamped, source.normals[at_corner])
    face = meshes.face_normals(corners)[:, None]
    normals = np.where((normals * face).sum(axis=-1, keepdims=True) > 0, normals, face)
    extrapolated = barycentric(source.corners[at_centre][:, None], corners)
    uv = {}
    for name, layer in source.uv.items():
        per_corner = np.einsum("mck,mckx->mcx", weights, layer[at_corner])
        from_centre = np.einsum("mck,mkx->mcx", extrapolated, layer[at_centre])
        torn = _is_torn(per_corner, corners, layer[at_centre], source.corners[at_centre])
        uv[name] = np.where(torn[:, None, None], from_centre, per_corner).astype(np.float32)
    named = {name: np.einsum("mck,mckx->mcx", clamped, layer[at_corner]).astype(np.float32)
             for name, layer in source.attributes.items()}
    return replace(source, corners=corners, normals=meshes.unit_or(normals, face), uv=uv, attributes=named,
                   slot=source.slot[at_centre])


def _is_torn(uv: np.ndarray, corners: np.ndarray, reference_uv: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """(m,) bool: the corners lie on different UV islands, so far apart are they for the size of the triangle."""
    flat = np.concatenate([reference_uv, np.zeros_like(reference_uv[..., :1])], axis=-1)
    density = np.sqrt(meshes.areas(flat) / np.maximum(meshes.areas(reference), 1e-300))
    spread = np.linalg.norm(uv - np.roll(uv, 1, axis=1), axis=2).max(axis=1)
    return spread > 4 * density * meshes.longest_edges(corners)
