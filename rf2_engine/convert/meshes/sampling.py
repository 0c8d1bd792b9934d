# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep a sample of many small things, such as leaves, hairs or triangles, and enlarge it to cover the same area.

Cook et al. 2007, "Stochastic Simplification of Aggregate Detail": large things are kept. Of the others, the smaller
they look the more are left out, spread evenly through space.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....model import progress
from ....model.geometry import pieces
from ..data import mesh as meshes
from ..data.mesh import TriangleMesh

LARGEST = 0.1   # size of an enlarged item at most, as a fraction of the extent of all
CELLS = 1 << 10  # along each axis, for the order in which items are visited
LEAST = 4       # triangles for each piece that has as many
SHARE = 0.8     # of the target is for pieces; the rest goes where the surface is curved
MISSED = 0.2    # of the area; where dropped pieces have less, such as screws of a machine, others are not enlarged


def keep_sample(area: np.ndarray, budget: float, *, cost: np.ndarray | None = None, positions: np.ndarray | None = None,
                sizes: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Choose some of p items by their areas (p,), so that their costs (p,) sum up to about the budget.

    Returns (p,) bool, the sample, and (p,) factors on length and width that preserve the total area.

    cost: None = 1 for all. positions: (p, 3); None = neighbours follow each other. sizes: (p,), if growth is limited.
    """
    cost = np.ones(len(area)) if cost is None else cost
    chance = _chances(area, cost, budget)
    order = slice(None) if positions is None else _along_a_curve(positions)
    along = np.cumsum(chance[order])
    is_kept = np.zeros(len(cost), bool)
    is_kept[order] = np.floor(along + 0.5) > np.floor(along - chance[order] + 0.5)
    growth = 1 / np.sqrt(chance.clip(1e-12))
    if sizes is not None and len(sizes):
        most = LARGEST * np.ptp(positions, axis=0).max() / np.maximum(sizes, 1e-300)
        growth = np.minimum(growth, most.clip(1))
    return is_kept, growth


def _chances(area: np.ndarray, cost: np.ndarray, budget: float) -> np.ndarray:
    """(p,) in proportion to the area, 1 at most, so that the expected cost is the budget."""
    if cost.sum() <= budget:
        return np.ones(len(cost))
    low, high = 0.0, max(float(area @ cost) / budget, 1e-300)
    for _ in range(40 if area.max() > high else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if (area / middle).clip(max=1) @ cost > budget else (low, middle)
    return (area / high).clip(max=1)


def _along_a_curve(positions: np.ndarray) -> np.ndarray:
    """Indices of (p, 3) positions in Morton's order, in which neighbours are close to each other."""
    if not len(positions):
        return np.zeros(0, int)
    positions = positions.astype(np.float64)
    low, extent = positions.min(axis=0), max(float(np.ptp(positions, axis=0).max()), 1e-300)
    cell = ((positions - low) * ((CELLS - 1) / extent)).astype(np.int64)
    code = np.zeros(len(positions), np.int64)
    for bit in range(CELLS.bit_length() - 1):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << 3 * bit + axis
    return np.argsort(code, kind="stable")


def thin_pieces(mesh: TriangleMesh, points: np.ndarray, faces: np.ndarray, target: int, space) -> TriangleMesh:
    """`mesh`, or, if much of it is pieces that do not fit into `target` triangles, an enlarged sample of them.

    points (v, 3), faces (n, 3): of the mesh, where pieces are connected. space: as for reduce.simplify.
    """
    # By Euler's formula a sheet without holes has more points than half its faces, and a closed piece two more.
    if len(points) - len(faces) / 2 <= target / LEAST:
        return mesh
    progress.report()
    piece = pieces(faces, len(points))[faces[:, 0]]
    cost = np.minimum(np.bincount(piece), LEAST)
    if cost.sum() <= SHARE * target:
        return mesh
    progress.report()
    corners = mesh.corners.astype(np.float64)
    apparent = corners if space is None else space.enter(corners.reshape(-1, 3)).reshape(corners.shape)
    low, high = _boxes(piece, corners)
    area = np.bincount(piece, meshes.areas(apparent))
    middle = (low + high) / 2
    is_kept, growth = keep_sample(area, SHARE * target, cost=cost, positions=middle, sizes=(high - low).max(axis=1))
    if area[~is_kept].sum() < MISSED * area.sum():
        return mesh
    rows = np.flatnonzero(is_kept[piece])
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
