# SPDX-License-Identifier: GPL-3.0-or-later
"""The share of light between surfaces that passes through the scene's volumes, on a coarse grid."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...geometry import rotation_matrix
from ...scene import CELLS, VOXELS, Volumes

SIDE = 32          # cells along the grid
STEPS = 6          # places on a way that are looked at
REACH = 2.0        # network units from the centre, along each axis, within which volumes count
SCATTERED = 0.85   # share of the scattered light that does not arrive


class Fog:
    """Grey extinction of `Volumes` in network units (docs/scene-input.md 5)."""

    def __init__(self, volumes: Volumes, device: torch.device | str = "cpu"):
        points, extinction = (torch.as_tensor(x, dtype=torch.float32, device=device) for x in _voxels(volumes))
        near = (points.abs() < REACH).all(1)
        points, extinction = points[near], extinction[near]
        corners = points if len(points) else points.new_zeros(1, 3)
        margin = 1e-3
        self.low = corners.amin(0) - margin
        self.cell = (corners.amax(0) + margin - self.low) / SIDE
        self.density = torch.zeros(SIDE ** 3 + 1, device=device)  # the last is that of all places outside
        self.density.index_add_(0, self._index(points), extinction / self.cell.prod())

    def passing(self, begin: Tensor, end: Tensor) -> Tensor:
        """(...) share of the light that gets from points (..., 3) to points (..., 3)."""
        way = end - begin
        return (-self._mean(begin, way) * way.norm(dim=-1)).exp()

    def _mean(self, begin: Tensor, way: Tensor) -> Tensor:
        """(...) mean extinction between points (..., 3) and points + way."""
        return sum(self.density[self._index(begin + (k + 0.5) / STEPS * way)] for k in range(STEPS)) / STEPS

    def _index(self, points: Tensor) -> Tensor:
        place = ((points - self.low) / self.cell).floor()
        outside = ((place < 0) | (place >= SIDE)).any(-1)
        x, y, z = place.clamp(0, SIDE - 1).long().unbind(-1)
        return ((x * SIDE + y) * SIDE + z).masked_fill(outside, SIDE ** 3)


def fog_of(volumes: Volumes | None, device: torch.device | str = "cpu") -> Fog | None:
    """None where nothing is in the way."""
    return Fog(volumes, device) if volumes is not None and len(volumes) else None


def _voxels(volumes: Volumes) -> tuple[np.ndarray, np.ndarray]:
    """Centres (V, 3) of all voxels, and their extinction per network unit times their volume (V,)."""
    step = ((np.arange(VOXELS) + 0.5) / VOXELS - 0.5) / CELLS
    local = np.stack(np.meshgrid(step, step, step, indexing="ij")[::-1], axis=-1).reshape(-1, 3)  # x fastest
    turned = np.stack([rotation_matrix(euler) for euler in volumes.rotation])
    points = volumes.position[:, None] + np.einsum("mij,mvj->mvi", turned, local * volumes.scale[:, None])
    lost = (volumes.absorption + SCATTERED * volumes.scattering).mean(1) / np.sqrt((volumes.scale**2).mean(1))
    voxel = volumes.scale.prod(1) / (CELLS * VOXELS) ** 3
    return points.reshape(-1, 3), (volumes.density * (lost * voxel)[:, None]).reshape(-1)
