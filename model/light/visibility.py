# SPDX-License-Identifier: GPL-3.0-or-later
"""Visibility between points, by rays (model/rays.py), for tensors on any device."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..rays import Rays


class Visibility:
    """Rays against triangles (T, 3, 3); all arguments are in network units."""

    def __init__(self, triangles: np.ndarray):
        self.rays = Rays(triangles)

    def nearest(self, origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
        """Triangle (P,) i64, -1 if none, and distance (P,), infinite if none, from (P, 3) along unit vectors (P, 3)."""
        met = self.rays.closest(_array(origin), _array(direction))
        return (torch.from_numpy(met.triangle).to(origin.device, torch.long),
                torch.from_numpy(met.distance).to(origin.device))

    def blocked(self, origin: Tensor, direction: Tensor, distance: Tensor | float = float("inf")) -> Tensor:
        """(P,) bool: whether something stands within `distance` (P,) of points (P, 3) along unit vectors (P, 3)."""
        far = _array(distance) if isinstance(distance, Tensor) else distance
        return torch.from_numpy(self.rays.blocked(_array(origin), _array(direction), far)).to(origin.device)


def _array(x: Tensor) -> np.ndarray:
    return x.detach().cpu().numpy()
