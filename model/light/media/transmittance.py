# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's media on a coarse grid, and the transmittance between two points."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...geometry import rotation_matrix
from ...scene import CELLS, VOXELS, Fire, RenderScene, Volumes

SIDE = 32          # cells along the grid
STEPS = 6          # samples of the extinction along a ray
NO_VOXELS = np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros((0, 3), np.float32)
REACH = 2.0        # network units from the centre, along each axis, within which media count


class Fog:
    """Grey extinction, scattering and emission of media per network unit (docs/scene-input.md 5).

    density, scattering, emission: (SIDE^3 + 1,), (SIDE^3 + 1, 3) twice, x slowest; the last is that of all places
    outside. emission: None without fire.
    """

    def __init__(self, volumes: Volumes | None, device: torch.device | str = "cpu", fire: Fire | None = None):
        voxels = NO_VOXELS if volumes is None else _voxels(volumes)
        if fire is not None:
            none = np.zeros_like(fire.radiance)
            voxels = [np.concatenate(both) for both in zip(
                (*voxels, np.zeros_like(voxels[2])),
                (fire.position, none[:, 0], none, fire.radiance * fire.size[:, None] ** 2), strict=True)]
        points, *coefficients = (torch.as_tensor(x, dtype=torch.float32, device=device) for x in voxels)
        near = (points.abs() < REACH).all(1)
        points = points[near]
        corners = points if len(points) else points.new_zeros(1, 3)
        margin = 1e-3
        self.low = corners.amin(0) - margin
        self.cell = (corners.amax(0) + margin - self.low) / SIDE
        self.density, self.scattering, *emission = (
            x.new_zeros(SIDE ** 3 + 1, *x.shape[1:]).index_add(0, self._index(points), x[near] / self.cell.prod())
            for x in coefficients)
        self.emission = emission[0] if emission else None

    def transmittance(self, begin: Tensor, end: Tensor) -> Tensor:
        """(...) share of the light that gets from points (..., 3) to points (..., 3)."""
        ray = end - begin
        return (-self._mean_extinction(begin, ray) * ray.norm(dim=-1)).exp()

    def points_in(self, cells: Tensor, within: Tensor) -> Tensor:
        """(P, 3) points in cells by number (P,); within: (P, 3) in [0, 1), where in its cell each point is."""
        x, y, z = cells // SIDE ** 2, cells // SIDE % SIDE, cells % SIDE
        return self.low + (torch.stack([x, y, z], dim=1) + within) * self.cell

    def _mean_extinction(self, begin: Tensor, ray: Tensor) -> Tensor:
        """(...) between points (..., 3) and points + ray."""
        return sum(self.density[self._index(begin + (k + 0.5) / STEPS * ray)] for k in range(STEPS)) / STEPS

    def _index(self, points: Tensor) -> Tensor:
        place = ((points - self.low) / self.cell).floor()
        outside = ((place < 0) | (place >= SIDE)).any(-1)
        x, y, z = place.clamp(0, SIDE - 1).long().unbind(-1)
        return ((x * SIDE + y) * SIDE + z).masked_fill(outside, SIDE ** 3)


def fog_of(scene: RenderScene, device: torch.device | str = "cpu") -> Fog | None:
    """The fog of a scene; None where it has no media."""
    volumes = scene.volumes if scene.volumes is not None and len(scene.volumes) else None
    return None if volumes is None and scene.fire is None else Fog(volumes, device, scene.fire)


def _voxels(volumes: Volumes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres (V, 3) of all voxels, their extinction (V,) and scattering (V, 3) per network unit times their volume."""
    step = ((np.arange(VOXELS) + 0.5) / VOXELS - 0.5) / CELLS
    local = np.stack(np.meshgrid(step, step, step, indexing="ij")[::-1], axis=-1).reshape(-1, 3)  # x fastest
    turned = np.stack([rotation_matrix(euler) for euler in volumes.rotation])
    points = volumes.position[:, None] + np.einsum("mij,mvj->mvi", turned, local * volumes.scale[:, None])
    lost = (volumes.absorption + volumes.scattering).mean(1)
    voxel = volumes.scale.prod(1) / (CELLS * VOXELS) ** 3 / np.sqrt((volumes.scale**2).mean(1))
    amount = volumes.density * voxel[:, None]
    return (points.reshape(-1, 3), (amount * lost[:, None]).reshape(-1),
            (amount[..., None] * volumes.scattering[:, None]).reshape(-1, 3))
