# SPDX-License-Identifier: GPL-3.0-or-later
"""What the two sides of surfaces are open to: patches must not reach from a room through its walls to the outside."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...geometry import area_vectors, quartered
from ..direct.environment_light import LIFT
from ..sampling import cosine_directions, hashed_starts
from ..tensor_rays import TensorRays

LARGEST = 2048   # triangles, the largest, that are tested in each round
RAYS = 8         # from a point to each side
COVERED = 0.75   # share of rays that hit backs, from which on a point is inside of something
OUTSIDE = 0.2    # share of rays that hit nothing, from which on it is outside
POINTS = (1 / 3, 1 / 3), (0.8, 0.1), (0.1, 0.8), (0.1, 0.1)  # weights of two corners, the middle first
UNLIKE = 0.3     # difference between the shares of rays that hit nothing, from which on a triangle is quartered
BURIED = 0.4     # weight of the same difference for rays that hit backs
ROUNDS = 3       # that a triangle is quartered at most


class Openness:
    """What rays from points hit of the triangles (T, 3, 3) that stop light."""

    def __init__(self, triangles: np.ndarray, rays: TensorRays, device: torch.device):
        normal = F.normalize(torch.from_numpy(area_vectors(triangles)).to(device), dim=-1)
        self.normal = F.pad(normal, (0, 0, 0, 1))  # the row behind all is for rays that hit nothing
        self.rays, self.device = rays, device

    def kinds(self, corners: np.ndarray) -> np.ndarray:
        """(N,) i64, equal for triangles (N, 3, 3) whose middles are open to the same on both sides."""
        shares = self._shares(corners, POINTS[0])
        kind = (shares[..., 0] > COVERED) + 2 * (shares[..., 1] > OUTSIDE)
        return 3 * kind[:, 0] + kind[:, 1]

    def _shares(self, corners: np.ndarray, weights: tuple[float, float]) -> np.ndarray:
        """(N, 2, 2) shares of the rays from a point on fronts and backs that hit backs, and that hit nothing."""
        weights = np.float32((*weights, 1 - sum(weights)))
        point = torch.from_numpy(np.einsum("nkc,k->nc", corners, weights)).to(self.device)
        normal = F.normalize(torch.from_numpy(area_vectors(corners)).to(self.device), dim=-1)
        return torch.stack([self._side(point, n) for n in (normal, -normal)], 1).cpu().numpy()

    def _side(self, x: Tensor, n: Tensor) -> Tensor:
        direction = cosine_directions(n, RAYS, hashed_starts(x, 2)).flatten(0, 1)
        triangle, distance = self.rays.nearest((x + LIFT * n).repeat_interleave(RAYS, 0), direction)
        missed, is_back = distance.isinf(), (self.normal[triangle] * direction).sum(-1) > 0
        return torch.stack([is_back, missed], 1).view(-1, RAYS, 2).float().mean(1)

    def cut(self, corners: np.ndarray, source: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
        """(S, 3, 3) triangles and (S,) rows that they come from, up to `most` more than before.

        Triangles are quartered that are not open to the same all over.
        """
        fresh = np.arange(len(corners))
        for _ in range(ROUNDS):
            area = np.linalg.norm(area_vectors(corners[fresh]), axis=1)
            large = np.argsort(-area, kind="stable")[:LARGEST]
            shares = np.stack([self._shares(corners[fresh[large]], point) for point in POINTS])
            apart = (np.ptp(shares, axis=0) * (BURIED, 1)).max(axis=(1, 2))
            order = np.argsort(-apart * area[large], kind="stable")
            chosen = fresh[large[order[apart[order] > UNLIKE]]][:most // 3]
            rest = np.delete(np.arange(len(corners)), chosen)
            corners = np.concatenate([corners[rest], quartered(corners[chosen])])
            source = np.concatenate([source[rest], np.tile(source[chosen], 4)])
            fresh = np.arange(len(rest), len(corners))
            most -= 3 * len(chosen)
        return corners, source
