# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's media on a coarse grid, and the transmittance between two points."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...geometry import rotation_matrix
from ...scene import CELLS, VOXELS, Fire, RenderScene, Volumes

SIDE = 32          # cells along the grid
STEPS = 6          # samples of the extinction along a ray
SPLIT = 2          # parts of a voxel along each axis, so that none skips a cell
NO_VOXELS = tuple(np.zeros((0, count), np.float32) for count in (3, 3, 1, 3))
REACH = 2.0        # network units
GREY = 0.02        # difference between colours of the extinction, as a share of it, up to which media are grey


class Fog:
    """Extinction, scattering and emission of media per unit of length (docs/scene-input.md 5).

    extinction: (SIDE^3, C), x slowest; C is 1 if all media are grey, else 3. Nothing is outside the grid.
    scattering, emission: (SIDE^3, 3) likewise; emission is None without fire.
    """

    def __init__(self, volumes: Volumes | None, device: torch.device | str = "cpu", fire: Fire | None = None,
                 reach: float = REACH):
        """reach: from the centre, along each axis, within which media count."""
        voxels = NO_VOXELS if volumes is None else _voxels(volumes)
        if fire is not None:
            none, emitted = np.zeros_like(fire.radiance), fire.radiance * fire.size[:, None] ** 2
            reaches = np.repeat(fire.size[:, None] / 2, 3, axis=1)
            voxels = [np.concatenate(both) for both in zip(
                (*voxels, np.zeros_like(voxels[3])),
                (fire.position, reaches, none[:, :voxels[2].shape[1]], none, emitted), strict=True)]
        points, reaches, *coefficients = (torch.as_tensor(x, dtype=torch.float32, device=device) for x in voxels)
        near = (points.abs() < reach).all(1)
        points, reaches = points[near], reaches[near]
        ends = torch.cat([points - reaches, points + reaches]) if len(points) else points.new_zeros(1, 3)
        margin = 1e-3
        self.low = ends.amin(0) - margin
        self.cell = (ends.amax(0) + margin - self.low) / SIDE
        self.extinction, self.scattering, *emission = self._divided(points, [x[near] for x in coefficients])
        self.emission = emission[0] if emission else None

    def transmittance(self, begin: Tensor, end: Tensor) -> Tensor:
        """(..., C) share of the light that gets from points (..., 3) to points (..., 3)."""
        ray = end - begin
        enters, leaves = self.crossed(begin, ray)
        begin, ray = begin + enters * ray, (leaves - enters) * ray
        return (-self._mean_extinction(begin, ray) * ray.norm(dim=-1, keepdim=True)).exp()

    def along(self, begin: np.ndarray, direction: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """(P, C) the same from points (P, 3) along unit vectors (P, 3) for distances (P,), which may be infinite."""
        return self.transmittance(*self.segments(begin, direction, distance)).cpu().numpy()

    def segments(self, begin: np.ndarray, direction: np.ndarray, distance: np.ndarray) -> tuple[Tensor, Tensor]:
        """Both ends (P, 3) of the same, those that are infinite as long as the grid reaches at least."""
        begin, direction, distance = (torch.from_numpy(x).to(self.low) for x in (begin, direction, distance))
        size = SIDE * self.cell
        farthest = (begin - self.low - size / 2).norm(dim=-1) + size.norm()
        return begin, begin + torch.minimum(distance, farthest)[:, None] * direction

    def crossed(self, begin: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        """Shares (..., 1) of rays (..., 3) from points (..., 3) at which they enter and leave the grid."""
        near, far = ((side - begin) / torch.where(ray.abs() < 1e-9, 1e-9, ray)
                     for side in (self.low, self.low + SIDE * self.cell))
        enters = torch.minimum(near, far).amax(-1, keepdim=True).clamp(0, 1)
        return enters, torch.maximum(torch.maximum(near, far).amin(-1, keepdim=True).clamp(0, 1), enters)

    def _divided(self, points: Tensor, amounts: list[Tensor]) -> list[Tensor]:
        """(SIDE^3, C) mean in each cell of amounts (V, C) at points (V, 3), shared by the cells around each."""
        place = ((points - self.low) / self.cell - 0.5).clamp(0, SIDE - 1)
        low = place.floor().clamp(max=SIDE - 2)
        share, cells = place - low, [x.new_zeros(SIDE ** 3, x.shape[1]) for x in amounts]
        for corner in torch.cartesian_prod(*[torch.arange(2, device=points.device)] * 3):
            weight = torch.where(corner > 0, share, 1 - share).prod(1, keepdim=True) / self.cell.prod()
            number = self._number((low.long() + corner).unbind(1))
            for whole, amount in zip(cells, amounts):
                whole.index_add_(0, number, weight * amount)
        return cells

    def cells_at(self, x: Tensor) -> Tensor:
        """Numbers (P,) of the cells that points (P, 3) are in."""
        return self._number(((x - self.low) / self.cell).clamp(0, SIDE - 1).long().unbind(-1))

    def points_in(self, cells: Tensor, within: Tensor) -> Tensor:
        """(P, 3) points in cells by number (P,); within: (P, 3) in [0, 1), where in its cell each point is."""
        x, y, z = cells // SIDE ** 2, cells // SIDE % SIDE, cells % SIDE
        return self.low + (torch.stack([x, y, z], dim=1) + within) * self.cell

    def as_volume(self, cells: Tensor) -> Tensor:
        """(1, C, SIDE, SIDE, SIDE) values of the cells (SIDE^3, C), for `interpolated`."""
        return cells.T.reshape(1, -1, SIDE, SIDE, SIDE)

    def interpolated(self, volume: Tensor, x: Tensor) -> Tensor:
        """(P, C) of the result of `as_volume` between the cells, at points (P, 3)."""
        position = (2 * (x - self.low) / (SIDE * self.cell) - 1).flip(-1)
        return F.grid_sample(volume, position.view(1, -1, 1, 1, 3), align_corners=False,
                             padding_mode="border")[0, :, :, 0, 0].T

    def _mean_extinction(self, begin: Tensor, ray: Tensor) -> Tensor:
        """(..., C) between points (..., 3) and points + ray, all of them in the grid."""
        place, step = (begin - self.low) / self.cell, ray / self.cell / STEPS
        cells = ((place + (k + 0.5) * step).clamp(0, SIDE - 1).long().unbind(-1) for k in range(STEPS))
        return sum(self.extinction[self._number(cell)] for cell in cells) / STEPS

    @staticmethod
    def _number(place: Sequence[Tensor]) -> Tensor:
        x, y, z = place
        return (x * SIDE + y) * SIDE + z


def fog_of(scene: RenderScene, device: torch.device | str = "cpu", reach: float = REACH) -> Fog | None:
    """The fog of a scene; None where it has no media."""
    volumes = scene.volumes or None
    return None if volumes is None and scene.fire is None else Fog(volumes, device, scene.fire, reach)


def _voxels(volumes: Volumes) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Middles (V, 3) of the parts of all voxels, how far these reach (V, 3) from there along each axis, and, times
    their volume, extinction (V, C) and scattering (V, 3)."""
    side = VOXELS * SPLIT
    step = ((np.arange(side) + 0.5) / side - 0.5) / CELLS
    local = np.stack(np.meshgrid(step, step, step, indexing="ij")[::-1], axis=-1).reshape(-1, 3)  # x fastest
    turned = np.stack([rotation_matrix(euler) for euler in volumes.rotation])
    points = volumes.position[:, None] + np.einsum("mij,mvj->mvi", turned, local * volumes.scale[:, None])
    reaches = np.einsum("mij,mj->mi", np.abs(turned), volumes.scale) / (2 * CELLS * side)
    lost = volumes.absorption + volumes.scattering
    if (np.ptp(lost, axis=1) <= GREY * lost.mean(1)).all():
        lost = lost.mean(1, keepdims=True)
    part = volumes.scale.prod(1) / (CELLS * side) ** 3 / np.sqrt((volumes.scale**2).mean(1))
    density = volumes.density.reshape(-1, VOXELS, VOXELS, VOXELS)
    for axis in (1, 2, 3):
        density = density.repeat(SPLIT, axis)
    amount = density.reshape(len(volumes), -1) * part[:, None]
    count = amount.shape[1]
    return points.reshape(-1, 3), reaches.repeat(count, 0), *(
        (amount[..., None] * of_cell[:, None]).reshape(-1, of_cell.shape[1]) for of_cell in (lost, volumes.scattering))
