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
            length = offset[:, same].norm(dim=0)
            lift = (LIFT + STEEPNESS * length) * here[1][:, same]
            ray = offset[:, same].T / length.clamp_min(1e-9)[:, None]
            between[same] = occluders.is_blocked((here[0][:, same] + lift).T, ray, length).to(walls.dtype)
            self._walls.append(walls.cumsum(axis))
        self.exists = any(bool(walls.any()) for walls in self._walls)  # waits for a GPU

    def between(self, row: Tensor, column: Tensor, other_row: Tensor, other_column: Tensor) -> Tensor:
        """Bool of two pixels each, as their indices broadcast: walls are on both ways that turn once."""
        down, right = self._walls

        def differs(walls: Tensor, r: Tensor, c: Tensor, s: Tensor, d: Tensor) -> Tensor:
            return walls[r, c] != walls[s, d]
        across_first = (differs(right, row, column, row, other_column)
                        | differs(down, row, other_column, other_row, other_column))
        down_first = (differs(down, row, column, other_row, column)
                      | differs(right, other_row, column, other_row, other_column))
        return across_first & down_first
