# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects and meshes with a volume shader as occupied cells (docs/scene-input.md 5, mostly 5.3-5.6)."""
from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mathutils.bvhtree import BVHTree

from ...model import progress
from ...model.geometry import euler_angles
from ...model.scene import Volumes

MAX_CELLS = 1024          # what the published networks were trained with (docs/scene-input.md 2.4)
CELLS = 8                 # cells per axis of a box
VOXELS = 4                # voxels per axis of a cell
OCCUPIED = 0.02           # a cell whose densest voxel is not above this fraction of the box's maximum is dropped
FINE_MEDIA = 16, 128      # of the largest begin with CELLS per axis, with half as many; all others with a quarter


@dataclass
class Medium:
    """One participating medium: a box in the world and a density inside it."""

    name: str
    rotation: np.ndarray    # (3, 3) f64, box axes to world, right-handed
    center: np.ndarray      # (3,) f64, world
    size: np.ndarray        # (3,) f64, world side lengths
    scattering: np.ndarray  # (3,) f64, coefficient per world unit at density 1
    absorption: np.ndarray  # (3,) f64
    density: Callable[[int], np.ndarray]  # r -> (r, r, r) density of the box's voxels, [x, y, z] along the box axes

    def corners(self) -> np.ndarray:
        """(8, 3) of the box, world, the last axis fastest."""
        local = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * self.size
        return local @ self.rotation.T + self.center

    def holds(self, point: np.ndarray) -> bool:
        """True if a world point (3,) is inside the box."""
        return bool((np.abs((point - self.center) @ self.rotation) < self.size / 2).all())

    def points(self, resolution: int) -> np.ndarray:
        """(r, r, r, 3) world centres of the voxels, [x, y, z]."""
        axis = (np.arange(resolution) + 0.5) / resolution - 0.5
        local = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1) * self.size
        return local @ self.rotation.T + self.center


def box_around(matrix: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation (3, 3), centre (3,) and side lengths (3,) of the box along the axes of a (4, 4) object matrix.

    corners: (k, 3) points of the object, in its own frame, that the box must hold. Mirrored and sheared matrices get
    a right-handed, orthogonal box all the same.
    """
    rotation, upper = np.linalg.qr(matrix[:3, :3].astype(np.float64))
    rotation = rotation * np.where(np.diag(upper) < 0, -1.0, 1.0)
    if np.linalg.det(rotation) < 0:
        rotation[:, 2] *= -1
    along = (corners @ matrix[:3, :3].T + matrix[:3, 3]) @ rotation
    low, high = along.min(axis=0), along.max(axis=0)
    return rotation, rotation @ ((low + high) / 2), high - low


def cells(media: list[Medium], report) -> Volumes | None:
    """All occupied cells, at most `MAX_CELLS`; None if there are none.

    Boxes are drawn with fewer, larger cells (the finest first) when they do not fit, and the report says so.
    """
    per_axis, parts = [CELLS] * len(media), []
    for rank, i in enumerate(np.argsort([-np.prod(medium.size) for medium in media], kind="stable")):
        per_axis[i] = CELLS >> sum(rank >= most for most in FINE_MEDIA)
    for i, medium in enumerate(media):
        with progress.part(0.7 * i / len(media), 0.7 * (i + 1) / len(media)):
            parts.append(_occupied(medium, per_axis[i]))
    too_many = surplus = sum(map(len, parts)) - MAX_CELLS
    finest_first = [(float(np.prod(medium.size) * (CELLS / per_axis[i]) ** 3), i) for i, medium in enumerate(media)]
    heapq.heapify(finest_first)
    with progress.part(0.7, 1.0):
        while surplus > 0 and finest_first:
            volume, i = heapq.heappop(finest_first)
            per_axis[i] //= 2
            done = max(1 - surplus / too_many, 0)
            with progress.part(done, done):
                before, parts[i] = len(parts[i]), _occupied(media[i], per_axis[i])
            surplus += len(parts[i]) - before
            if per_axis[i] > 1:
                heapq.heappush(finest_first, (volume * 8, i))
    room = MAX_CELLS
    for i, medium in enumerate(media):
        if len(parts[i]) > room:
            report.skipped(medium.name, f"the scene has more than {MAX_CELLS} volume cells")
            parts[i] = _occupied(medium, 0)
        elif len(parts[i]) == 0:
            report.skipped(medium.name, "the volume is empty")
        elif per_axis[i] < CELLS:
            report.approximated(medium.name, f"drawn with {per_axis[i]} cells per axis instead of {CELLS}")
        room -= len(parts[i])
    return Volumes.concatenate(parts) if any(map(len, parts)) else None


def _occupied(medium: Medium, per_axis: int) -> Volumes:
    """The cells of one medium on a `per_axis`^3 grid.

    The network derives the size of a cell from its box: `CELLS` of them per axis. A coarser grid is therefore the
    middle of a proportionally larger box.
    """
    progress.report()
    n = per_axis
    density = medium.density(n * VOXELS) if n else np.zeros((0, 0, 0))
    peak = float(density.max(initial=0))
    blocks = (density / (peak or 1)).reshape(n, VOXELS, n, VOXELS, n, VOXELS).transpose(0, 2, 4, 5, 3, 1)
    kept = blocks.max(axis=(3, 4, 5), initial=0) > OCCUPIED
    position = medium.points(n)[kept] if n else np.zeros((0, 3))
    count = len(position)
    scale = medium.size * CELLS / max(n, 1)
    # Coefficients belong to a box whose optical depth does not change with its size (docs/scene-input.md 5.4).
    unit = peak * np.sqrt(np.mean(np.square(scale)))
    rows = (euler_angles(medium.rotation), scale, medium.scattering * unit, medium.absorption * unit)
    return Volumes(blocks[kept].reshape(count, VOXELS ** 3).astype(np.float32), position.astype(np.float32),
                   *(np.tile(row, (count, 1)).astype(np.float32) for row in rows))


def mesh_medium(name: str, matrix: np.ndarray, corners: np.ndarray, coefficients: Callable, report) -> Medium:
    """The inside of a closed mesh, filled evenly or as its shader says.

    corners: (n, 3, 3) in the frame of the object; coefficients: scattering and absorption per world unit at places
    (..., 3) of that frame, (3,) each or (..., 3).
    """
    flat = corners.reshape(-1, 3).astype(np.float64)
    rotation, center, size = box_around(matrix, flat)
    local = ((flat @ matrix[:3, :3].T + matrix[:3, 3] - center) @ rotation) / np.maximum(size, 1e-30)
    tree = BVHTree.FromPolygons(local.tolist(), np.arange(len(local)).reshape(-1, 3).tolist(), all_triangles=True)

    def shader(places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Scattering, absorption, and the mean over the colours of both, at world places."""
        scattering, absorption = coefficients((places - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T)
        return scattering, absorption, (scattering + absorption).mean(axis=-1)

    def filling(resolution: int) -> np.ndarray:
        centres = (np.arange(resolution) + 0.5) / resolution - 0.5
        filled = np.zeros((resolution,) * 3, np.float32)
        for i, x in enumerate(centres):
            progress.report(i / resolution)
            for j, y in enumerate(centres):
                # A hair off the centre, so that no ray runs along the edges of a regular mesh.
                crossings = _crossings(tree, x + 1.3e-4, y + 2.7e-4)
                for enter, leave in zip(crossings[::2], crossings[1::2], strict=False):
                    filled[i, j, (centres > enter) & (centres < leave)] = 1
        return filled

    medium = Medium(name, rotation, center, size, np.zeros(3), np.zeros(3), filling)
    scattering, absorption, extinction = shader(medium.points(2))
    if extinction.ndim == 0:
        medium.scattering, medium.absorption = scattering, absorption
        return medium
    scattering, absorption, extinction = shader(medium.points(CELLS))
    tints = (scattering / np.maximum(extinction[..., None], 1e-12)).reshape(-1, 3)[extinction.ravel() > 0]
    if len(tints) and np.ptp(tints, axis=0).max() > 0.05:
        report.approximated(name, "the colour of its volume varies, and is shown as its mean")
    total = max(float(extinction.sum()), 1e-12)
    medium.scattering, medium.absorption = (np.broadcast_to(c, (*extinction.shape, 3)).sum(axis=(0, 1, 2)) / total
                                            for c in (scattering, absorption))
    medium.density = lambda n: filling(n) * shader(medium.points(n))[2].astype(np.float32)
    return medium


def _crossings(tree, x: float, y: float) -> list[float]:
    """Heights at which the vertical line through (x, y) meets the surface, ascending."""
    heights, start = [], -1.0
    while (hit := tree.ray_cast((x, y, start), (0, 0, 1))[0]) is not None and len(heights) < 1000:
        heights.append(hit.z)
        start = hit.z + 1e-5
    return heights
