# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles that are sliced and quartered again and again, and the piece that a point on one of them lies in."""
from __future__ import annotations

from functools import cache

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...geometry import area_vectors, quartered
from ..direct.terminator import edge_heights, heights
from .slices import Slices, sharp_corners, weights_of_parts

CANDIDATES = 1 << 14  # triangles, the largest, that may be quartered
DEEPEST = 8           # times


class Subdivision:
    """Some triangles (R,) of many (G, 3, 3), of which `corners` (C, 3, 3) are those that may be quartered."""

    def __init__(self, triangles: np.ndarray, rows: np.ndarray):
        self._triangles = triangles
        if len(rows) > CANDIDATES:
            area = np.linalg.norm(area_vectors(triangles[rows]), axis=1)
            large = np.zeros(len(rows), bool)
            large[np.argpartition(-area, CANDIDATES)[:CANDIDATES]] = True
            rows, self.whole = rows[large], rows[~large]
        else:
            self.whole = rows[:0]
        self.corners, self.source = triangles[rows], rows
        self._weights = np.tile(np.eye(3, dtype=np.float32), (len(rows), 1, 1))  # of the corners of the source
        self._depth = np.zeros(len(rows), np.int64)
        self._part, self._slices = self.source, None  # of a triangle, as of Slices

    def slice(self, count: np.ndarray) -> None:
        """Cut pieces, which are whole triangles, into so many slices (C,), before any is quartered."""
        cut, triangles = np.flatnonzero(count > 1), len(self._triangles)
        if not len(cut):
            return
        sharp, rest = sharp_corners(self.corners[cut])[0], np.flatnonzero(count == 1)
        slices = list(map(cache(_slices), sharp.tolist(), count[cut].tolist()))  # many are alike
        weights, inverse = map(np.concatenate, zip(*slices, strict=True))
        parts = np.array([len(own) for own, _ in slices])
        source = self.source[cut].repeat(parts)
        first = np.arange(triangles + 1)
        counts, sharps = np.ones_like(first), np.zeros_like(first)
        first[self.source[cut]] = triangles + np.cumsum(parts) - parts
        first[-1] = -1
        counts[self.source[cut]], sharps[self.source[cut]] = count[cut], sharp
        self._slices = Slices(*map(torch.from_numpy, (first, counts, sharps, inverse)))
        self._part = np.concatenate([self.source[rest], triangles + np.arange(len(source))])
        self.source = np.concatenate([self.source[rest], source])
        self._weights = np.concatenate([self._weights[rest], weights])
        self.corners = self._weights @ self._triangles[self.source]
        self._depth = np.zeros(len(self.source), np.int64)

    def quarter(self, chosen: np.ndarray) -> np.ndarray:
        """Quarter pieces by their rows; returns the rows (K,) of the new ones, all behind the others."""
        chosen = chosen[~self.is_deepest[chosen]]
        rest = np.delete(np.arange(len(self.corners)), chosen)
        self.corners, self._weights = (np.concatenate([x[rest], quartered(x[chosen])])
                                       for x in (self.corners, self._weights))
        self.source, self._part, self._depth = (np.concatenate([x[rest], np.tile(more, 4)]) for x, more in (
            (self.source, self.source[chosen]), (self._part, self._part[chosen]),
            (self._depth, self._depth[chosen] + 1)))
        return np.arange(len(rest), len(self.corners))

    @property
    def is_deepest(self) -> np.ndarray:
        """(C,) bool, pieces that `quarter` leaves as they are."""
        return self._depth == DEEPEST

    def pieces(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (S, 3, 3) and sources (S,) of all pieces, those that stayed whole behind the others."""
        return (np.concatenate([self.corners, self._triangles[self.whole]]), np.concatenate([self.source, self.whole]))

    def interpolated(self, values: np.ndarray) -> np.ndarray:
        """(S, 3, C) at the corners of all pieces, of values (G, 3, C) at those of the triangles."""
        return np.concatenate([self._weights @ values[self.source], values[self.whole]])

    def heights(self, normals: np.ndarray) -> Tensor:
        """(S, 3) of the curved surface that triangles with normals (G, 3, 3) stand for, above the corners of pieces."""
        of_edges = edge_heights(*(torch.from_numpy(x[self.source]) for x in (self._triangles, normals)))
        of_pieces = heights(of_edges[:, None], torch.from_numpy(self._weights))
        return F.pad(of_pieces, (0, 0, 0, len(self.whole)))

    def locator(self) -> PieceLocator:
        """Finds the pieces, for what hits the triangles."""
        triangles, none = len(self._triangles), len(self.source) + len(self.whole)
        parts, own_weights = triangles, self._weights
        if self._slices:
            parts += len(self._slices.inverse)
            of_slice = self._part >= triangles
            own_weights = own_weights.copy()
            inverse = self._slices.inverse.numpy()[self._part[of_slice] - triangles]
            own_weights[of_slice] = own_weights[of_slice] @ inverse.transpose(0, 2, 1)
        deepest = np.zeros(parts, np.int64)
        np.maximum.at(deepest, self._part, self._depth)
        is_split = deepest > 0
        size = np.where(is_split, 2 * 4 ** deepest, 1)
        begin = np.cumsum(size) - size
        table = np.full(size.sum() + 1, none)  # the last entry is for what is no part of the triangles
        is_whole = ~is_split[self._part]
        table[begin[self._part[is_whole]]] = np.flatnonzero(is_whole)
        table[begin[self.whole]] = len(self.source) + np.arange(len(self.whole))
        piece = np.flatnonzero(~is_whole)
        weights, depth, part = own_weights[piece], self._depth[piece], self._part[piece]
        while len(piece):  # down to the cells of the table, which all pieces of a part are divided into
            done = depth == deepest[part]
            middle, side = torch.from_numpy(weights[done].mean(axis=1)), torch.from_numpy(2 ** depth[done])
            table[begin[part[done]] + _cells(middle[:, :2], side).numpy()] = piece[done]
            weights, depth, part, piece = (x[~done] for x in (weights, depth, part, piece))
            weights = quartered(weights)
            depth, part, piece = np.tile(depth + 1, 4), np.tile(part, 4), np.tile(piece, 4)
        side, begin = np.append(np.where(is_split, 2 ** deepest, 1), 1), np.append(begin, len(table) - 1)
        return PieceLocator(*map(torch.from_numpy, (side, begin, table)), self._slices)


class PieceLocator:
    """Tables of the pieces of G parts of triangles, each of which has as many cells along its edges as its smallest
    piece."""

    def __init__(self, side: Tensor, begin: Tensor, table: Tensor, slices: Slices | None = None):
        """side, begin: (G + 1,) i64 cells along an edge, and first entry of the table; table: (K,) i64 pieces."""
        self._side, self._begin, self._table, self._slices = side, begin, table, slices
        self._is_split = bool((side > 1).any())

    def to(self, device: torch.device) -> PieceLocator:
        return PieceLocator(*(x.to(device) for x in (self._side, self._begin, self._table)),
                            self._slices and self._slices.to(device))

    def find(self, triangle: Tensor, weights: Tensor) -> Tensor:
        """Pieces (P,) i64 at weights (P, 2) of corners 0 and 1 of triangles (P,); one behind all for triangle -1."""
        part = triangle
        if self._slices:
            part, weights = self._slices.find(triangle, weights)
        cell = self._begin[part]
        if self._is_split:
            cell = cell + _cells(weights, self._side[part])
        return self._table[cell]


def _slices(sharp: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """`weights_of_parts` (K, 3, 3), and what makes of weights of the whole triangle those of a part, (K, 3, 3)."""
    weights = weights_of_parts(sharp, count)
    return weights, np.linalg.inv(weights.transpose(0, 2, 1).astype(np.float64)).astype(np.float32)


def _cells(weights: Tensor, side: Tensor) -> Tensor:
    """Entries (P,) of tables of triangles divided into side^2 (P,), at weights (P, 2)."""
    along = weights.clip(0, 1) * side[:, None]
    row = torch.minimum(along[:, 0].long(), side - 1)
    column = torch.minimum(along[:, 1].long(), side - 1 - row)
    is_upper = ((along[:, 0] - row) + (along[:, 1] - column) > 1) & (row + column < side - 1)
    return (row * side + column) * 2 + is_upper.long()
