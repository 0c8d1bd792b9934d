# SPDX-License-Identifier: GPL-3.0-or-later
"""Which distant light reaches a scene past what stands far around it, such as a sky dome or the walls of a hall.

Shadow maps know only what is near (`shadow_maps.NEAR`).
"""
from __future__ import annotations

import torch
from torch import Tensor

from .shadow_maps import NEAR
from .voxels import Voxels

PLACES = 8    # in the middle of the scene that light must reach
MIDDLE = 0.5  # network units from the centre: where they are


def unblocked(solid: Tensor, towards: Tensor) -> Tensor:
    """(L,) share of places where light from unit directions (L, 3) arrives past (T, 3, 3) triangles beyond NEAR."""
    if not (solid.norm(dim=-1) > NEAR).any() or not len(towards):
        return torch.ones_like(towards[:, 0])
    middle = solid.mean(1)
    middle = middle[middle.norm(dim=-1) < MIDDLE]
    places = middle[::max(len(middle) // PLACES, 1)][:PLACES] if len(middle) else torch.zeros_like(solid[:1, 0])
    rays = towards[:, None].expand(-1, len(places), -1)
    met, _ = Voxels(solid)((places + NEAR * rays).reshape(-1, 3), rays.reshape(-1, 3))
    return (met < 0).float().view(len(towards), -1).mean(1)
