# SPDX-License-Identifier: GPL-3.0-or-later
"""Fewer triangles for meshes that do not fit the token budget, by QSlim (docs/scene-input.md 2.3)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from mathutils.bvhtree import BVHTree

from ...model import progress
from ...model.errors import SceneError
from ...model.geometry import barycentric
from . import mesh as meshes
from .mesh import TriangleMesh

COARSEST = 8     # no mesh is simplified further, unless it has fewer triangles to begin with
KEPT_WHOLE = 64  # a mesh this small keeps all its triangles as long as the budget allows


def share_budget(counts, copies, budget: int) -> np.ndarray:
    """(k,) int triangles each mesh may keep so that sum(copies * result) <= budget.

    counts: (k,) triangles per mesh; copies: (k,) instances of it. Meshes shrink in proportion, small ones last, and
    none below `COARSEST`: for that many the budget must suffice.
    """
    counts, copies = np.asarray(counts, np.int64), np.asarray(copies, np.int64)
    if (counts * copies).sum() <= budget:
        return counts
    floor = KEPT_WHOLE
    while floor > COARSEST and (np.minimum(counts, floor) * copies).sum() > budget:
        floor //= 2
    low, high = 0.0, 1.0
    for _ in range(40):
        ratio = (low + high) / 2
        fits = (_shrunk(counts, floor, ratio) * copies).sum() <= budget
        low, high = (ratio, high) if fits else (low, ratio)
    return _shrunk(counts, floor, low)


def simplify(mesh: TriangleMesh, target: int) -> TriangleMesh:
    """At most `target` triangles of about the same shape.

    Normals, UVs, colours and material slots come from the nearest original triangle.
    Raises SceneError if the simplifier is not installed.
    """
    if len(mesh) <= target:
        return mesh
    try:
        import fast_simplification
    except ImportError as error:
        raise SceneError("The scene has more triangles than the Triangle Budget, and the package that reduces them, "
                         "fast-simplification, is missing: use Render Properties > RenderFormer-V2 > Install Packages, "
                         "or raise the budget") from error
    progress.report(0.0)
    points, faces, owner = _with_fins(*_welded(mesh.corners), mesh.slot)
    progress.report(0.1)
    tree = BVHTree.FromPolygons(points.tolist(), faces.tolist(), all_triangles=True)
    upright = meshes.face_normals(points[faces])
    progress.report(0.2)
    points, faces = fast_simplification.simplify(points, faces, target_count=target)
    corners = points[faces].astype(np.float32)
    corners = corners[np.isfinite(corners).all(axis=(1, 2))]
    corners = corners[meshes.has_area(corners)]
    with progress.part(0.5, 1.0):
        nearest = _nearest(corners, tree)
    centre, face = nearest[:, 3], meshes.face_normals(corners)
    fin = (centre >= len(mesh)) & (np.abs((upright[centre] * face).sum(axis=1)) > 0.7)
    # Separate pieces are never merged: if that leaves too many triangles, the largest are kept.
    kept = np.argsort(np.where(fin, 0, -meshes.areas(corners)), kind="stable")[:min(target, np.count_nonzero(~fin))]
    if len(kept) == 0:
        return mesh.take(np.argsort(-meshes.areas(mesh.corners), kind="stable")[:target])
    kept.sort()
    return _dressed(corners[kept], mesh, owner[nearest[kept]])


def _shrunk(counts: np.ndarray, floor: int, ratio: float) -> np.ndarray:
    return np.maximum(np.minimum(counts, floor), (counts * ratio).astype(np.int64))


def _welded(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shared (v, 3) f32 points and (n, 3) i32 faces; corners are one point if their coordinates are equal."""
    flat = corners.reshape(-1, 3).astype(np.float32) + np.float32(0)  # -0 and 0 are one point
    bits = np.ascontiguousarray(flat).view(np.uint32).astype(np.uint64)
    key = bits @ np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return flat[first], inverse.reshape(-1, 3).astype(np.int32)


def _with_fins(points: np.ndarray, faces: np.ndarray, slot: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and faces with an upright triangle on every edge where the mesh or a material ends; the face of each.

    QSlim alone sees no error in cutting the corners off a flat wall; fins keep such edges in place.
    """
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    low, high = np.sort(edges, axis=1).astype(np.int64).T
    key = (low * len(points) + high) * (int(slot.max()) + 1) + np.repeat(slot, 3)
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    ends = np.sort(first[count == 1])
    start, end = points[edges[ends]].transpose(1, 0, 2)
    height = np.linalg.norm(end - start, axis=1, keepdims=True)
    tips = (start + end) / 2 + height * meshes.face_normals(points[faces[ends // 3]])
    fins = np.column_stack([edges[ends, ::-1], len(points) + np.arange(len(ends))])
    return (np.concatenate([points, tips]).astype(np.float32), np.concatenate([faces, fins]).astype(np.int32),
            np.concatenate([np.arange(len(faces)), ends // 3]))


def _nearest(corners: np.ndarray, tree: BVHTree) -> np.ndarray:
    """(m, 4) i64: the triangle of `tree` nearest to the three corners and the centre of each of (m, 3, 3)."""
    centre = corners.mean(axis=1, keepdims=True)
    # Corners are looked up a little inside their triangle: at a crease or seam they belong to its side.
    inside = 0.95 * corners + 0.05 * centre
    found = []
    batches = np.array_split(np.concatenate([inside, centre], axis=1), len(corners) // 5000 + 1)
    for i, batch in enumerate(batches):
        progress.report(i / len(batches))
        found += [tree.find_nearest(point)[2] for point in batch.reshape(-1, 3).tolist()]
    return np.array(found, np.int64).reshape(-1, 4)


def _dressed(corners: np.ndarray, source: TriangleMesh, nearest: np.ndarray) -> TriangleMesh:
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
        torn = _torn(per_corner, corners, layer[at_centre], source.corners[at_centre])
        uv[name] = np.where(torn[:, None, None], from_centre, per_corner).astype(np.float32)
    colors = {name: np.einsum("mck,mckx->mcx", clamped, layer[at_corner]).astype(np.float32)
              for name, layer in source.colors.items()}
    return replace(source, corners=corners, normals=meshes.unit_or(normals, face), uv=uv, colors=colors,
                   slot=source.slot[at_centre])


def _torn(uv: np.ndarray, corners: np.ndarray, reference_uv: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """(m,) bool: the corners lie on different UV islands, so far apart are they for the size of the triangle."""
    flat = np.concatenate([reference_uv, np.zeros_like(reference_uv[..., :1])], axis=-1)
    density = np.sqrt(meshes.areas(flat) / np.maximum(meshes.areas(reference), 1e-300))
    spread = np.linalg.norm(uv - np.roll(uv, 1, axis=1), axis=2).max(axis=1)
    return spread > 4 * density * meshes.longest_edges(corners)
