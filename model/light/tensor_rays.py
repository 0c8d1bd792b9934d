# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays (model/rays.py) for tensors on any device."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..rays import Rays


class TensorRays:
    """Rays against triangles (T, 3, 3), in the units that these have."""

    def __init__(self, triangles: np.ndarray):
        self.rays = Rays(triangles)

    def nearest(self, origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
        """First hits from points (P, 3) along unit vectors (P, 3).

        Returns the triangle (P,) i64, -1 where nothing is hit, and the distance (P,), infinite there.
        """
        hits = self.rays.closest(_to_numpy(origin), _to_numpy(direction))
        return (torch.from_numpy(hits.triangle).to(origin.device, torch.long),
                torch.from_numpy(hits.distance).to(origin.device))

    def is_blocked(self, origin: Tensor, direction: Tensor, distance: Tensor | float = float("inf")) -> Tensor:
        """(P,) bool: whether a triangle is hit within `distance` (P,) of points (P, 3) along unit vectors (P, 3)."""
        limit = _to_numpy(distance) if isinstance(distance, Tensor) else distance
        return torch.from_numpy(self.rays.blocked(_to_numpy(origin), _to_numpy(direction), limit)).to(origin.device)


def _to_numpy(x: Tensor) -> np.ndarray:
    return x.detach().cpu().numpy()
