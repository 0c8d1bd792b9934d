# SPDX-License-Identifier: GPL-3.0-or-later
"""Perlin's gradient noise (2002) in one to four dimensions over lattice points hashed as Blender does."""
from __future__ import annotations

import itertools

import numpy as np

from .hashing import jenkins
from .lattice import Lattice, in_blocks

RANGE = {1: 0.25, 2: 0.6616, 3: 0.982, 4: 0.8344}  # Blender's, so that the noise stays within -1 and 1
PERIOD, TOO_FAR = np.float32(100_000), np.float32(1_000_000)
AXES = {  # along which each kind of slope rises or falls, by dimensions
    2: [(0, 1)] * 4 + [(1, 0)] * 4,
    3: [(0, 1)] * 4 + [(0, 2)] * 4 + [(1, 2)] * 4 + [(1, 0), (1, 2)] * 2,
    4: [(0, 1, 2)] * 8 + [(0, 1, 3)] * 8 + [(0, 2, 3)] * 8 + [(1, 2, 3)] * 8,
}


def _gradients(dimensions: int) -> np.ndarray:
    """(dimensions, kinds) f32: the slopes that the last bits of a hash choose among."""
    if dimensions == 1:
        return np.float32([[(1 + (k & 7)) * (-1 if k & 8 else 1) for k in range(16)]])
    rows = np.zeros((len(AXES[dimensions]), dimensions), np.float32)
    for k, (row, axes) in enumerate(zip(rows, AXES[dimensions], strict=True)):
        for bit, axis in enumerate(axes):
            row[axis] = (2 if dimensions == 2 and bit else 1) * (-1 if k >> bit & 1 else 1)
    return rows.T.copy()


GRADIENTS = {dimensions: _gradients(dimensions) for dimensions in RANGE}


def perlin(at: np.ndarray) -> np.ndarray:
    """Noise, -1 to 1, at points (..., d), d from 1 to 4 -> (...) f32."""
    at = np.asarray(at, np.float32)
    near = np.nan_to_num(np.fmod(at, PERIOD)) + np.float32(0.5) * (np.abs(at) >= TOO_FAR)
    return in_blocks(lambda points: [_perlin(points)], near)[0]


def _perlin(points: np.ndarray) -> np.ndarray:
    """(d, m) -> (m,)."""
    dimensions = len(points)
    slopes = GRADIENTS[dimensions]
    kinds = np.uint32(slopes.shape[1] - 1)
    cell = np.floor(points)
    part = points - cell
    smooth = part * part * part * (part * (part * 6 - 15) + 10)
    sides = (part, 1 - smooth), (part - 1, smooth)  # way to the lattice point and its weight
    lattice = Lattice(lambda where: (jenkins(*where) & kinds)[None], cell.astype(np.int64), 0, 1)
    result = np.zeros(points.shape[1], np.float32)
    for corner in itertools.product((0, 1), repeat=dimensions):
        kind = lattice[corner][0]
        slope = sum(slopes[axis].take(kind) * sides[side][0][axis] for axis, side in enumerate(corner))
        for axis, side in enumerate(corner):
            slope = slope * sides[side][1][axis]
        result += slope
    return np.float32(RANGE[dimensions]) * result
