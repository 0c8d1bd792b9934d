# SPDX-License-Identifier: GPL-3.0-or-later
"""Functions of integer lattice points, for the noises: evaluated around the cells in which points lie."""
from __future__ import annotations

import numpy as np

from .....model import progress

BLOCK = 1 << 13  # points at once: what fits into the processor's cache


class Lattice:
    """Values of a function around cells. Where the cells lie close together, each lattice point is computed once."""

    def __init__(self, function, cell: np.ndarray, low: int, high: int):
        """function: (d, ...) integers -> (c, ...). cell: (d, m). low, high: of the offsets."""
        self.function, self.cell = function, cell
        first = cell.min(axis=1) + low
        self.extent = cell.max(axis=1) + high + 1 - first
        self.table = None
        if np.prod(self.extent, dtype=float) <= (high - low + 1) ** len(cell) * cell.shape[1] / 2:
            grid = first[:, None] + np.indices(self.extent).reshape(len(cell), -1)
            self.table = function(grid)
            self.index = np.ravel_multi_index(cell - first[:, None], self.extent)
            self.strides = np.append(np.cumprod(self.extent[:0:-1])[::-1], 1)

    def __getitem__(self, offset) -> np.ndarray:
        """(c, m) values at the cells moved by one offset (d,), or each by its own (d, m)."""
        if self.table is None:
            return self.function(self.cell + np.reshape(offset, (len(self.cell), -1)))
        return self.table.take(self.index + np.dot(self.strides, offset), axis=1)


def in_blocks(function, at: np.ndarray, *more) -> list[np.ndarray]:
    """A function of points (d, m) and values (m,), evaluated at arrays (..., d) and (...), block by block.

    It returns arrays (m,) or (m, c); what comes back is (...) or (..., c).
    """
    shape = np.broadcast_shapes(at.shape[:-1], *(np.shape(value) for value in more))
    points = np.broadcast_to(at, shape + at.shape[-1:]).reshape(-1, at.shape[-1]).T
    values = [np.broadcast_to(value, shape).reshape(-1) for value in more]
    blocks = []
    for start in range(0, points.shape[1], BLOCK):
        if shape:
            progress.report()
        part = slice(start, start + BLOCK)
        blocks.append(function(np.ascontiguousarray(points[:, part]), *(value[part] for value in values)))
    results = [np.concatenate(column) for column in zip(*blocks, strict=True)]
    return [values.reshape(shape + values.shape[1:]) for values in results]
