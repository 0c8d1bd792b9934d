# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample meshes with more pieces than the budget allows, such as the leaves of a tree."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....model import progress
from ....model.geometry import connected
from ..data import mesh as meshes
from ..data.mesh import TriangleMesh
from .sampling import keep_some

LEAST = 4       # triangles for each piece that has as many
SHARE = 0.8     # of the triangles wanted at most are planned for these; what is left over goes where it bends
MISSED = 0.2    # of the area is what leaves are worth: fewer, such as the screws of a machine, are not enlarged


def thinned(mesh: TriangleMesh, points: np.ndarray, faces: np.ndarray, target: int, lens) -> TriangleMesh:
    """`mesh`, or if much of it is pieces that do not fit into `target` triangles, some of them that stand for all.

    points (v, 3), faces (n, 3): of the mesh, where pieces are connected. lens: as for reduce.simplify.
    """
    # By Euler's formula a sheet without holes has more points than half its faces, and a closed piece two more.
    if len(points) - len(faces) / 2 <= target / LEAST:
        return mesh
    progress.report()
    piece = np.unique(connected(faces, len(points))[faces[:, 0]], return_inverse=True)[1]
    cost = np.minimum(np.bincount(piece), LEAST)
    if cost.sum() <= SHARE * target:
        return mesh
    progress.report()
    corners = mesh.corners.astype(np.float64)
    as_seen = corners if lens is None else lens.enter(corners.reshape(-1, 3)).reshape(corners.shape)
    low, high = _boxes(piece, corners)
    area = np.bincount(piece, meshes.areas(as_seen))
    middle = (low + high) / 2
    kept, growth = keep_some(area, SHARE * target, cost=cost, places=middle, sizes=(high - low).max(axis=1))
    if area[~kept].sum() < MISSED * area.sum():
        return mesh
    rows = np.flatnonzero(kept[piece])
    own = piece[rows]
    around = middle[own, None]
    larger = around + (corners[rows] - around) * growth[own, None, None]
    return replace(mesh.take(rows), corners=larger.astype(np.float32))


def _boxes(piece: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates (p, 3) of each piece."""
    order = np.argsort(piece, kind="stable")
    begin = np.searchsorted(piece[order], np.arange(piece.max() + 1))
    sorted_corners = corners[order]
    return (np.minimum.reduceat(sorted_corners.min(axis=1), begin),
            np.maximum.reduceat(sorted_corners.max(axis=1), begin))
