# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays (model/scene_rays.py) for tensors on any device."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..scene_rays import RaysAmong


class TensorHits(NamedTuple):
    """The first hits of P rays."""

    triangle: Tensor  # (P,) i64, row of the geometry; -1 = nothing
    distance: Tensor  # (P,), infinite = nothing
    weights: Tensor   # (P, 2) of the triangle's corners 0 and 1


class TensorRays:
    """Rays against some kinds of surfaces."""

    def __init__(self, rays: RaysAmong):
        self.rays = rays

    def nearest(self, origin: Tensor, direction: Tensor) -> TensorHits:
        """First hits from points (P, 3) along unit vectors (P, 3)."""
        hits = self.rays.closest(_to_numpy(origin), _to_numpy(direction))
        triangle, distance, weights = (torch.from_numpy(x).to(origin.device) for x in hits)
        return TensorHits(triangle.long(), distance, weights)

    def is_blocked(self, origin: Tensor, direction: Tensor, distance: Tensor | float = float("inf")) -> Tensor:
        """(P,) bool: whether a triangle is hit within `distance` (P,) of points (P, 3) along unit vectors (P, 3)."""
        limit = _to_numpy(distance) if isinstance(distance, Tensor) else distance
        return torch.from_numpy(self.rays.blocked(_to_numpy(origin), _to_numpy(direction), limit)).to(origin.device)


def _to_numpy(x: Tensor) -> np.ndarray:
    return x.detach().cpu().numpy()
