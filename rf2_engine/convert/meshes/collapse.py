# SPDX-License-Identifier: GPL-3.0-or-later
"""Fewer triangles by collapsing edges with quadric error metrics (Garland and Heckbert 1997), in numpy alone.

It takes the place of the package fast-simplification where that is not installed, and several times as long. Instead
of the cheapest edge, many are collapsed at a time: some of the cheap ones, that have no triangle in common.
"""
from __future__ import annotations

import numpy as np

from ....model import progress
from ..data import mesh as meshes

SHARE = 0.25      # of the excess triangles that are removed in a round, so that the cheapest edges are first
FEW = 64          # excess triangles that are removed in one round
CHEAP = 2         # candidates for each edge to be collapsed; more where most of them cannot be
TURNED = 0.5      # cosine of the largest angle by which a triangle may turn
BIAS = 1e-6       # of an edge's length to the fourth: among equal errors, short edges go first


def simplify(points: np.ndarray, faces: np.ndarray, target_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (v, 3) f64 and faces (m, 3) i32 of about `target_count` triangles, of points (V, 3) and faces (n, 3)."""
    points, faces = points.astype(np.float64), faces.astype(np.int64)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    quadrics = _quadrics(points, faces)
    begin, cheap, random = len(faces), CHEAP, np.random.default_rng(0)
    while (excess := len(faces) - target_count) > 0:
        progress.report((begin - len(faces)) / (begin - target_count))
        edges = _edges(faces)
        count = (max(int(SHARE * excess), min(FEW, excess)) + 1) // 2
        staying, removed, position = _collapsible(points, faces, quadrics, edges, count, cheap, random)
        if len(staying) < count / 4:
            if cheap * count > len(edges) and len(staying) == 0:
                break
            cheap *= 2
        quadrics[staying] += quadrics[removed]
        points[staying] = position
        names = np.arange(len(points))
        names[removed] = staying
        faces = names[faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    return points[used], faces.reshape(-1, 3).astype(np.int32)


def _edges(faces: np.ndarray) -> np.ndarray:
    """(e, 2) points of the edges, the lower one first."""
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    keys = np.unique(sides[:, 0] * (faces.max(initial=0) + 1) + sides[:, 1])
    return np.stack(np.divmod(keys, faces.max(initial=0) + 1), axis=1)


def _quadrics(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V, 10) squared distances from the planes of the faces at each point, by area: the upper triangle of a matrix."""
    corners = points[faces]
    normals = meshes.face_normals(corners).astype(np.float64)
    planes = np.column_stack([normals, -(normals * corners[:, 0]).sum(axis=1)])
    rows, columns = np.triu_indices(4)
    values = planes[:, rows] * planes[:, columns] * meshes.areas(corners)[:, None]
    return np.stack([np.bincount(faces.ravel(), value.repeat(3), len(points)) for value in values.T], axis=1)


def _collapsible(points: np.ndarray, faces: np.ndarray, quadrics: np.ndarray, edges: np.ndarray, count: int,
                 cheap: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """At most `count` edges, of the cheapest `cheap` times as many, that can be collapsed together.

    Returns (k,) points that stay, (k,) that are removed, and (k, 3) new positions of the former. Among neighbours the
    choice is random: errors change so smoothly that few edges are cheaper than all around them.
    """
    position, error = _best_positions(points, quadrics, edges)
    error += BIAS * np.square(np.square(points[edges[:, 0]] - points[edges[:, 1]]).sum(axis=1))
    if cheap * count < len(error):
        some = np.argpartition(error, cheap * count)[:cheap * count]
        edges, position = edges[some], position[some]
    order = random.permutation(len(edges))
    edges, position = edges[order], position[order]
    # A triangle belongs to the first of the edges at its corners; an edge that has all around it is independent.
    owner = np.full(len(points), len(edges))
    np.minimum.at(owner, edges.ravel(), np.repeat(np.arange(len(edges)), 2))
    around = owner[faces].min(axis=1)
    first = np.full(len(points), len(edges))
    np.minimum.at(first, faces.ravel(), np.repeat(around, 3))
    own = np.arange(len(edges))
    free = (first[edges] == own[:, None]).all(axis=1)
    moved = points.copy()
    moved[edges[free]] = position[free][:, None]
    rows = np.flatnonzero((around < len(edges)) & free[np.where(around < len(edges), around, 0)])
    of, ring = around[rows], faces[rows]
    has = ring[:, :, None] == edges[of][:, None, :]  # (r, 3, 2): the corner is this end of the edge
    free[_pinched(of, ring, has, len(points))] = False
    one = has.any(axis=2).sum(axis=1) == 1  # triangles with both ends are removed
    cosine = (meshes.face_normals(points[ring[one]]) * meshes.face_normals(moved[ring[one]])).sum(axis=1)
    free[of[one][cosine < TURNED]] = False
    chosen = np.flatnonzero(free)[:count]
    return edges[chosen, 0], edges[chosen, 1], position[chosen]


def _pinched(of: np.ndarray, ring: np.ndarray, has: np.ndarray, count: int) -> np.ndarray:
    """The edges whose ends have more neighbours in common than faces: two faces would become one, back to back.

    of: (r,) edges to which the faces `ring` (r, 3) around them belong.
    """
    keys, other, ends = of[:, None] * count + ring, ~has.any(axis=2), has.any(axis=1)
    of_first, of_second = (np.unique(keys[other & end[:, None]]) for end in ends.T)
    common, shared = np.intersect1d(of_first, of_second), np.unique(keys[other & ends.all(axis=1)[:, None]])
    return np.setdiff1d(common, shared) // count


def _best_positions(points: np.ndarray, quadrics: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(e, 3) best positions of the points that replace edges, and (e,) squared distances from their planes there."""
    quadric = quadrics[edges].sum(axis=1)
    a, b, c = points[edges[:, 0]], points[edges[:, 1]], (points[edges[:, 0]] + points[edges[:, 1]]) / 2
    xx, xy, xz, xw, yy, yz, yw, zz, zw, _ = quadric.T
    cofactors = [yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy]
    determinant = xx * cofactors[0] + xy * cofactors[1] + xz * cofactors[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        best = -np.stack([
            cofactors[0] * xw + cofactors[1] * yw + cofactors[2] * zw,
            cofactors[1] * xw + (xx * zz - xz * xz) * yw + (xy * xz - xx * yz) * zw,
            cofactors[2] * xw + (xy * xz - xx * yz) * yw + (xx * yy - xy * xy) * zw], axis=1) / determinant[:, None]
    near = np.square(best - c).sum(axis=1) < np.square(a - b).sum(axis=1)  # and not NaN
    positions = np.stack([np.where(near[:, None], best, c), c, a, b])
    errors = np.stack([_error(quadric, position) for position in positions])
    choice = errors.argmin(axis=0)
    return positions[choice, np.arange(len(edges))], errors.min(axis=0).clip(0)


def _error(quadric: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(e,) of quadrics (e, 10) at points (e, 3)."""
    xx, xy, xz, xw, yy, yz, yw, zz, zw, ww = quadric.T
    x, y, z = point.T
    return (x * (xx * x + 2 * (xy * y + xz * z + xw)) + y * (yy * y + 2 * (yz * z + yw)) + z * (zz * z + 2 * zw) + ww)
