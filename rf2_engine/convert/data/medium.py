# SPDX-License-Identifier: GPL-3.0-or-later
"""Participating media: densities in boxes of the world (docs/scene-input.md 5)."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ....model.scene import CELLS
from .arrays import UNIT_CUBE


@dataclass
class Box:
    """A box of the world."""

    rotation: np.ndarray    # (3, 3) f64, box axes to world, right-handed
    center: np.ndarray      # (3,) f64, world
    size: np.ndarray        # (3,) f64, world side lengths

    def corners(self) -> np.ndarray:
        """(8, 3) world, in the order of UNIT_CUBE."""
        local = (UNIT_CUBE - 0.5) * self.size
        return local @ self.rotation.T + self.center

    def holds(self, point: np.ndarray) -> bool:
        """True if a world point (3,) is inside."""
        return bool((np.abs((point - self.center) @ self.rotation) < self.size / 2).all())


@dataclass
class Medium:
    """One participating medium: a density inside of a box."""

    name: str
    box: Box
    scattering: np.ndarray  # (3,) f64, coefficient per world unit at density 1
    absorption: np.ndarray  # (3,) f64
    density: Callable[[int], np.ndarray]  # r -> (r, r, r) density of the box's voxels, [x, y, z] along the box axes
    emission: Callable[[int], np.ndarray] | None = None  # r -> (r, r, r, 3) radiance per world unit of length
    finest: int = CELLS     # cells per axis that show all there is to see
    _voxels: np.ndarray | None = field(default=None, repr=False)

    def voxels(self, resolution: int) -> np.ndarray:
        """`density`; where it is known twice as finely, the means of that."""
        if self._voxels is not None and len(self._voxels) == 2 * resolution:
            self._voxels = self._voxels.reshape(resolution, 2, resolution, 2, resolution, 2).mean(axis=(1, 3, 5))
        else:
            self._voxels = self.density(resolution)
        return self._voxels


def voxel_centres(box: Box, resolution: int) -> np.ndarray:
    """(r, r, r, 3) world, [x, y, z]."""
    axis = (np.arange(resolution) + 0.5) / resolution - 0.5
    local = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1) * box.size
    return local @ box.rotation.T + box.center


def box_around(matrix: np.ndarray, corners: np.ndarray) -> Box:
    """The box along the axes of a (4, 4) object matrix.

    corners: (k, 3) points of the object, in its own frame, that the box must hold. Mirrored and sheared matrices get
    a right-handed, orthogonal box all the same.
    """
    rotation, upper = np.linalg.qr(matrix[:3, :3].astype(np.float64))
    rotation = rotation * np.where(np.diag(upper) < 0, -1.0, 1.0)
    if np.linalg.det(rotation) < 0:
        rotation[:, 2] *= -1
    along = (corners @ matrix[:3, :3].T + matrix[:3, 3]) @ rotation
    low, high = along.min(axis=0), along.max(axis=0)
    return Box(rotation, rotation @ ((low + high) / 2), high - low)
