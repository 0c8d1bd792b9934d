# SPDX-License-Identifier: GPL-3.0-or-later
"""A sphere around some surfaces, by which most rays are known to miss them."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from .vectors import dot, length


class BoundingSphere(NamedTuple):
    center: Tensor  # (3,)
    radius: Tensor  # ()

    @classmethod
    def of(cls, corners: np.ndarray, device: torch.device | str) -> BoundingSphere:
        """Around triangles (T, 3, 3), of which there is one at least."""
        points = torch.from_numpy(corners).to(device).flatten(0, 1)
        center = (points.amin(0) + points.amax(0)) / 2
        return cls(center, length(points - center).amax())

    def is_near(self, origin: Tensor, direction: Tensor, distance: Tensor | float = float("inf"),
                width: Tensor | float = 0.0) -> Tensor:
        """(...) bool: whether rays (..., 3) that are so wide to each side meet the sphere within distances (...)."""
        to_center, radius = self.center - origin, self.radius + width
        along = dot(to_center, direction)
        aside2 = dot(to_center, to_center) - along.square()
        return (aside2 <= radius ** 2) & (along >= -radius) & (along - radius < distance)
