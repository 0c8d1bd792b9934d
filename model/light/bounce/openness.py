# SPDX-License-Identifier: GPL-3.0-or-later
"""What the two sides of surfaces are open to: patches must not reach from a room through its walls to the outside."""
from __future__ import annotations

from functools import partial

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...compute.threads import shared
from ...geometry import area_vectors
from ...progress import standing_still
from ...scene import RenderScene
from ..direct.environment_light import LIFT
from ..sampling import cosine_directions, hashed_starts
from ..tensor_rays import TensorRays
from ..vectors import dot
from .subdivision import Subdivision

LARGEST = 16384  # triangles, the largest, that are tested in each round
RAYS = 8         # from a point to each side
COVERED = 0.75   # share of rays that hit backs, from which on a point is inside of something
OUTSIDE = 0.2    # share of rays that hit nothing, from which on it is outside
MIDDLE = 1 / 3, 1 / 3  # weights of two corners
CORNERS = (0.94, 0.03), (0.03, 0.94), (0.03, 0.03)  # what cuts through a triangle has them on either side
UNLIKE = 0.3     # difference between the shares of rays that hit nothing, from which on a triangle is quartered
BURIED = 0.4     # weight of the same difference for rays that hit backs
ROUNDS = 5       # that a triangle is quartered at most


class Openness:
    """What rays from points hit of the surfaces of a scene that stop light."""

    def __init__(self, scene: RenderScene, rays: TensorRays, device: torch.device):
        self.rays, self.device, vectors = rays, device, area_vectors(scene.surfaces.triangles)
        self._vectors = F.pad(torch.from_numpy(vectors).to(device), (0, 0, 0, 1))  # the last one is that of nothing

    def kinds(self, corners: np.ndarray) -> np.ndarray:
        """(N,) i64, equal for triangles (N, 3, 3) whose middles are open to the same on both sides."""
        shares = self._shares(corners, MIDDLE)
        kind = (shares[..., 0] > COVERED) + 2 * (shares[..., 1] > OUTSIDE)
        return 3 * kind[:, 0] + kind[:, 1]

    def is_buried(self, x: Tensor, n: Tensor) -> Tensor:
        """(P,) bool, whether points (P, 3) with unit normals (P, 3) are inside of something, such as another object."""
        shares = shared(self._side, *(values.to(self.device).split(LARGEST) for values in (x, n)), device=self.device)
        return (torch.cat(shares)[:, 0] > COVERED).cpu()

    def _shares(self, corners: np.ndarray, weights: tuple[float, float]) -> np.ndarray:
        """(N, 2, 2) shares of the rays from a point on fronts and backs that hit backs, and that hit nothing."""
        weights = np.float32((*weights, 1 - sum(weights)))
        point = torch.from_numpy(np.einsum("nkc,k->nc", corners, weights)).to(self.device)
        normal = F.normalize(torch.from_numpy(area_vectors(corners)).to(self.device), dim=-1)
        return torch.stack([self._side(point, n) for n in (normal, -normal)], 1).cpu().numpy()

    def _side(self, x: Tensor, n: Tensor) -> Tensor:
        direction = cosine_directions(n, RAYS, hashed_starts(x, 2)).flatten(0, 1)
        hits = self.rays.nearest((x + LIFT * n).repeat_interleave(RAYS, 0), direction)
        missed = hits.distance.isinf()
        is_back = (dot(self._vectors[hits.triangle], direction) > 0) & ~missed
        return torch.stack([is_back, missed], 1).view(-1, RAYS, 2).float().mean(1)

    def cut(self, subdivision: Subdivision, most: int) -> None:
        """Quarter pieces that are not open to the same all over, into up to `most` more than before."""
        fresh = np.arange(len(subdivision.corners))
        for _ in range(ROUNDS):
            corners = subdivision.corners[fresh]
            area = np.linalg.norm(area_vectors(corners), axis=1)
            large = np.argsort(-area, kind="stable")[:LARGEST]
            with standing_still():
                shares = np.stack(shared(partial(self._shares, corners[large]), CORNERS, device=self.device))
            apart = (np.ptp(shares, axis=0) * (BURIED, 1)).max(axis=(1, 2))
            order = np.argsort(-apart * area[large], kind="stable")
            chosen = fresh[large[order[apart[order] > UNLIKE]]][:most // 3]
            fresh = subdivision.quarter(chosen)
            most -= 3 * len(chosen)
