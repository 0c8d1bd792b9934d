# SPDX-License-Identifier: GPL-3.0-or-later
"""Thin walls that are seen edge-on: no pixel shows them, but they keep light from the pixels beside them.

Where a floor goes on behind such a wall, positions and normals do not show it. So a ray is cast from a pixel to the
next along either axis that shows the same surface.
"""
from __future__ import annotations

import torch
from torch import Tensor

from .edge_stopping import edge_weights, plane_tolerance
from .tensor_rays import TensorRays
from .vectors import length

SAME_SURFACE = 0.1  # edge weight from which on two pixels show one surface
LIFT = 2e-3         # network units that rays start off their surface,
STEEPNESS = 0.1     # and in lengths of the ray: round surfaces must not be in the way


class Separation:
    """The walls between h x w pixels."""

    def __init__(self, position: Tensor, normal: Tensor, covered: Tensor, occluders: TensorRays):
        """position, normal: (3, h, w); covered: (h, w) bool."""
        tolerance = plane_tolerance(position, covered)
        self._walls = []  # (h, w) number of walls up to each pixel along columns, then along rows
        for axis in (0, 1):
            size = covered.shape[axis] - 1
            here, there = ([x.narrow(x.ndim - 2 + axis, start, size) for x in (position, normal, covered, tolerance)]
                           for start in (0, 1))
            walls = torch.zeros_like(tolerance)
            between = walls.narrow(axis, 1, size)
            offset = there[0] - here[0]
            same = (edge_weights(offset, there[1], here[1], here[3]) > SAME_SURFACE) & here[2] & there[2]
            distance = length(offset[:, same], 0)
            lift = (LIFT + STEEPNESS * distance) * here[1][:, same]
            ray = offset[:, same].T / distance.clamp_min(1e-9)[:, None]
            between[same] = occluders.is_blocked((here[0][:, same] + lift).T, ray, distance).to(walls.dtype)
            self._walls.append(walls.cumsum(axis))
        self.exists = any(bool(walls.any()) for walls in self._walls)  # waits for a GPU

    def between(self, row: Tensor, column: Tensor, other_row: Tensor, other_column: Tensor) -> Tensor:
        """Bool of two pixels each, as their indices broadcast: walls are on both ways that turn once."""
        down, right = self._walls
        here, across, below, there = (y * down.shape[1] + x for y in (row, other_row) for x in (column, other_column))

        def differs(walls: Tensor, a: Tensor, b: Tensor) -> Tensor:
            return walls.take(a) != walls.take(b)
        across_first = differs(right, here, across) | differs(down, across, there)
        down_first = differs(down, here, below) | differs(right, below, there)
        return across_first & down_first
