# SPDX-License-Identifier: GPL-3.0-or-later
"""Which distant light reaches a scene past what stands far around it, such as a sky dome or the walls of a hall.

Shadow maps know only what is near (`shadow_maps.NEAR`).
"""
from __future__ import annotations

from functools import cached_property

import torch
from torch import Tensor

from ..bounce.voxels import Voxels
from .shadow_maps import NEAR

PLACES = 8    # in the middle of the scene that light must reach
MIDDLE = 0.5  # network units from the centre: where they are


class FarBlockers:
    """What stops light beyond NEAR, of (T, 3, 3) corners of all triangles that stop any."""

    def __init__(self, triangles: Tensor):
        middle = triangles.mean(1)
        middle = middle[middle.norm(dim=-1) < MIDDLE]
        self.triangles, self.any = triangles, bool((triangles.norm(dim=-1) > NEAR).any())
        self.places = middle[::max(len(middle) // PLACES, 1)][:PLACES] if len(middle) else triangles.new_zeros(1, 3)

    @cached_property
    def voxels(self) -> Voxels:
        return Voxels(self.triangles)

    def unblocked(self, towards: Tensor) -> Tensor:
        """(L,) share of the places where light from unit directions (L, 3) arrives."""
        if not self.any or not len(towards):
            return torch.ones_like(towards[:, 0])
        rays = towards[:, None].expand(-1, len(self.places), -1)
        met, _ = self.voxels((self.places + NEAR * rays).reshape(-1, 3), rays.reshape(-1, 3))
        return (met < 0).float().view(len(towards), -1).mean(1)
