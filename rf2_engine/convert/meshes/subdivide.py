# SPDX-License-Identifier: GPL-3.0-or-later
"""Split triangles that are large in the scene: the network was not trained on them (docs/scene-input.md 2.3)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..data import mesh as meshes
from ..data.mesh import TriangleMesh


def subdivide(corners: np.ndarray, cost: np.ndarray, max_edge: float, budget: int,
              warp=lambda points: points, apparent_sizes=None) -> tuple[np.ndarray, np.ndarray]:
    """Bisect the longest edges, largest triangles first, until none is above `max_edge` or `budget` is used up.

    corners: (n, 3, 3); cost: (n,) int, tokens that one more piece of the triangle takes (0 = must stay whole);
    budget: tokens that may be added. Edges are measured in units of `max_edge` after `warp` of their ends, or where
    is larger by `apparent_sizes`: of weights (m, 3, 3) and parents (m,), as returned, how large (m,) pieces appear.
    Returns parent (m,) i64, the triangle that a piece is cut from, and weights (m, 3, 3) f32, [piece, corner, parent
    corner], the barycentric coordinates of its corners; the pieces of a triangle cover it exactly.
    """
    def sizes(weights: np.ndarray, parent: np.ndarray) -> np.ndarray:
        size = meshes.longest_edges(warp(weights @ corners[parent]))
        if apparent_sizes is not None:
            size = np.maximum(size, apparent_sizes(weights, parent))
        return np.where(cost[parent] > 0, size, 0)

    parent = np.arange(len(corners))
    weights = np.tile(np.eye(3, dtype=np.float32), (len(corners), 1, 1))
    size = sizes(weights, parent)
    while len(parent):
        # Only the largest third of the sizes per round, so that a short budget goes to the largest triangles.
        chosen = np.flatnonzero(size > max(max_edge, 0.7 * size.max()))
        chosen = chosen[np.argsort(-size[chosen], kind="stable")]
        chosen = chosen[np.cumsum(cost[parent[chosen]]) <= budget]
        if len(chosen) == 0:
            break
        budget -= int(cost[parent[chosen]].sum())
        first, second = _halves(weights[chosen], warp(weights[chosen] @ corners[parent[chosen]]))
        weights[chosen], size[chosen] = first, sizes(first, parent[chosen])
        size = np.concatenate([size, sizes(second, parent[chosen])])
        weights = np.concatenate([weights, second])
        parent = np.concatenate([parent, parent[chosen]])
    return parent, weights


def pieces(mesh: TriangleMesh, parent: np.ndarray, weights: np.ndarray) -> TriangleMesh:
    """The triangles of `mesh` cut into pieces, from what `subdivide` returns."""
    parents = mesh.take(parent)
    cut = parents.mapped(lambda layer: weights @ layer)
    return replace(cut, normals=meshes.unit_or(cut.normals, parents.normals))


def _halves(weights: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    start = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).argmax(axis=1)
    row, end = np.arange(len(weights)), (start + 1) % 3
    middle = (weights[row, start] + weights[row, end]) / 2
    first, second = weights.copy(), weights.copy()
    first[row, end] = middle
    second[row, start] = middle
    return first, second
