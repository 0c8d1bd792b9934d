# SPDX-License-Identifier: GPL-3.0-or-later
"""QSlim (Garland and Heckbert 1997) for meshes of any size, by the package fast-simplification if it is installed."""
from __future__ import annotations

import importlib.util

import numpy as np

from ....model import progress
from ..data import mesh as meshes
from .nearest import divide, submesh

MANY = 64               # a mesh this many times too fine is first made coarser by cubes of 1 / FINE of the new edges,
FINE, COARSE = 12, 8    # and one that QSlim leaves STUCK times too fine, of 1 / COARSE
STUCK = 1.05
UNIT = 2.0              # the new edges, for QSlim
WHOLE = 200_000         # faces at most at one go, and before what is left of blocks is simplified together,
ROUGH = 4               # times the target, to which the first pass simplifies
FAST, DENSE = 30_000, 2.0  # without the package: more faces than FAST are merged, by DENSE cubes to a new edge


def reduce_points(points: np.ndarray, faces: np.ndarray, target: int) -> np.ndarray:
    """(3 m, 3) f64 corners of about `target` triangles that approximate the surface.

    Where QSlim gets stuck, points closer than a part of the new edges are merged: it turns no sliver over, and coarsens
    all around it instead.
    """
    edge = new_edge(points, faces, target)
    for cell, begin, end in (0, 0.0, 0.7), (edge / COARSE, 0.7, 1.0):
        with progress.part(begin, end):
            progress.report(0.0)
            merged, remaining = _clustered(points, faces, cell) if cell else (points, faces)
            if len(remaining) <= target:
                return merged[remaining].reshape(-1, 3)
            # Its steps towards larger errors suit lengths of about 1.
            merged, remaining = _roughly(merged * (UNIT / edge), remaining, target)
            with progress.part(0.8, 1.0):
                progress.report(0.0)
                simplified, shape = _simplify(merged, remaining, target_count=target)
        if len(shape) <= STUCK * target:
            break
    return (simplified * (edge / UNIT))[shape].reshape(-1, 3)


def new_edge(points: np.ndarray, faces: np.ndarray, target: int) -> float:
    """About the length of the edges of a surface of `target` triangles."""
    areas = meshes.in_pieces(lambda some: meshes.areas(points[some]))
    return float(np.sqrt(areas(faces).sum() / target))


def without_detail(points: np.ndarray, faces: np.ndarray, target: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merge points of a mesh that is many times too fine: all that are closer than a small part of the new edges.

    Returns the indices of the points that are left, (m, 3) faces of these, and which of `faces` they are.
    """
    return _merged(points, faces, new_edge(points, faces, target) / FINE)


def _simplify(points: np.ndarray, faces: np.ndarray, **options) -> tuple[np.ndarray, np.ndarray]:
    try:
        from fast_simplification import simplify
    except ImportError:
        from .collapse import simplify
    return simplify(points, faces, **options)


def _roughly(points: np.ndarray, faces: np.ndarray, target: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and faces of a very large mesh simplified block by block, whose borders stay as they are.

    Without the package points of it are merged.
    """
    if importlib.util.find_spec("fast_simplification") is None:
        too_fine = len(faces) > max(ROUGH * target, FAST)
        return _clustered(points, faces, UNIT / DENSE) if too_fine else (points, faces)
    if len(faces) <= WHOLE:
        return points, faces
    share = max(ROUGH * target, WHOLE) / len(faces)
    if share > 1 / 2:
        return points, faces
    pieces, before = [], 0
    progress.report(0.1)
    parts = divide(meshes.middles(points[faces]))
    for i, rows in enumerate(parts):
        progress.report(0.2 + 0.6 * i / len(parts))
        vertices, shape = _simplify(*submesh(points, faces[rows]), preserve_border=True,
                                    target_count=max(int(share * len(rows)), 1))
        pieces.append((vertices, shape + before))
        before += len(vertices)
    vertices, shape = (np.concatenate(column) for column in zip(*pieces, strict=True))
    bits = np.ascontiguousarray(vertices + 0.0).view(np.dtype((np.void, 3 * vertices.itemsize)))[:, 0]
    _, first, inverse = np.unique(bits, return_index=True, return_inverse=True)
    return vertices[first], inverse[shape].astype(np.int32)


def _clustered(points: np.ndarray, faces: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and faces with one point for all in a cube of this side."""
    chosen, faces, _ = _merged(points, faces, cell)
    return points[chosen], faces


def _merged(points: np.ndarray, faces: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices of one point for all in a cube of this side, that nearest to their mean; faces of these points, and
    which of `faces` they are."""
    cells = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    size = cells.max(axis=0) + 1
    _, inverse, count = np.unique((cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2],
                                  return_inverse=True, return_counts=True)
    mean = np.stack([np.bincount(inverse, points[:, i]) for i in range(3)], axis=1) / count[:, None]
    order = np.lexsort((np.square(points - mean[inverse]).sum(axis=1), inverse))
    chosen = order[np.cumsum(count) - count]
    faces = inverse[faces].astype(np.int32)
    rows = np.flatnonzero((faces != np.roll(faces, 1, axis=1)).all(axis=1))
    return chosen, faces[rows], rows
