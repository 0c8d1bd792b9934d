# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects, simulated gas, and meshes with a volume shader, as media."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ....model.scene import CELLS
from ..data.copied import CopiedVolume, Grid, Instance
from ..data.medium import Box, Medium, box_around, voxel_centres
from ..data.report import Report
from ..shading.volume import volume_coefficients, volume_emission, volume_points
from .grids import in_box
from .inside import fill_voxels

EVEN = 4          # cells per axis of a box that is the same everywhere
SAME_TINT = 0.05  # most difference in colour that is not worth a remark
# What Cycles shades a Volume object without material with: Principled Volume, colour 0.5, density 1.
DEFAULT_GRID, DEFAULT_COEFFICIENT = "density", 0.5


def shaded_medium(name: str, box: Box, coefficients: Callable, report: Report, filling: Callable | None = None,
                  emission: Callable | None = None) -> Medium:
    """A box that is not the same everywhere, or is.

    coefficients: world positions (r, r, r, 3) of all voxels of the box -> scattering and absorption, (3,) or
    (r, r, r, 3), per world unit; filling: r -> (r, r, r) share of each voxel that is filled, None = all of it;
    emission: of the same positions, radiance per world unit, (3,) or (r, r, r, 3).
    Tokens of a box know one colour, so its colour is the mean one, and its extinction that of all colours together.
    """
    full = filling or (lambda resolution: np.ones((resolution,) * 3, np.float32))

    def glow(resolution: int) -> np.ndarray:
        return full(resolution)[..., None] * emission(voxel_centres(box, resolution))

    glows = None if emission is None else glow
    scattering, absorption = coefficients(voxel_centres(box, CELLS))
    if scattering.ndim == absorption.ndim == 1:
        return Medium(name, box, scattering, absorption, full, glows, EVEN if filling is None else CELLS)
    scattering, absorption = (np.broadcast_to(c, (CELLS, CELLS, CELLS, 3)) for c in (scattering, absorption))
    both = scattering + absorption
    extinction = both.mean(axis=-1)
    thick = extinction.ravel() > 0
    tints = np.concatenate([scattering, both], axis=-1).reshape(-1, 6)[thick] / extinction.ravel()[thick, None]
    if len(tints) and np.ptp(tints, axis=0).max() > SAME_TINT:
        report.approximated(name, "the color of its volume varies: the mean is used")
    total = max(float(extinction.sum()), 1e-12)

    def density(resolution: int) -> np.ndarray:
        both = coefficients(voxel_centres(box, resolution))
        return full(resolution) * sum(np.float32(c).mean(axis=-1) for c in both)

    return Medium(name, box, scattering.sum(axis=(0, 1, 2)) / total, absorption.sum(axis=(0, 1, 2)) / total, density,
                  glows)


def grid_medium(name: str, matrix: np.ndarray, grids: dict[str, Grid], coefficients, report: Report,
                emission=None) -> Medium:
    """The medium that one or more grids of an object fill, along the axes of the first.

    matrix: (4, 4) object to world; coefficients: scattering and absorption per world unit, (3,) or (..., 3), at
    positions (..., 3) of the object, given a function of the name of a grid that returns its values (..., c) there, or
    None. emission: the same of radiance per world unit.
    """
    grids = {key: grid.moved(matrix) for key, grid in grids.items()}
    first = next(iter(grids.values())).to_space
    corners = [grid.corners() @ grid.to_space[:3, :3].T + grid.to_space[:3, 3] for grid in grids.values()]
    box = box_around(first, (np.concatenate(corners) - first[:3, 3]) @ np.linalg.pinv(first[:3, :3]).T)
    to_object = np.linalg.pinv(matrix)

    def at(function: Callable, points: np.ndarray):
        def values(name: str) -> np.ndarray | None:
            return in_box(grids[name], box, len(points)) if name in grids else None
        return function(points @ to_object[:3, :3].T + to_object[:3, 3], values)

    return shaded_medium(name, box, partial(at, coefficients), report,
                         emission=None if emission is None else partial(at, emission))


def gridded(volume: CopiedVolume, report: Report) -> Medium:
    """The grids of a Volume object or of gas."""
    corners = np.float32(volume.box)[[0, 6]]
    texture_space = np.stack([corners.mean(axis=0), np.ptp(corners, axis=0) / 2])
    scale = np.sqrt(np.mean(volume.instance.matrix[:3, :3] ** 2) * 3)
    unit = 1.0 if volume.is_per_world_unit else 1 / max(scale, 1e-30)

    def coefficients(inside, values):
        if volume.material:
            points = volume_points(inside, texture_space, volume.instance, values)
            return [unit * c for c in volume_coefficients(volume.material, report, points)]
        return [unit * DEFAULT_COEFFICIENT * values(DEFAULT_GRID) * np.ones(3)] * 2

    def emission(inside, values):
        return unit * volume_emission(volume.material, report,
                                      volume_points(inside, texture_space, volume.instance, values))

    if volume.grids is not None:
        return grid_medium(volume.name, volume.instance.matrix, volume.grids, coefficients, report,
                           emission if volume.material else None)
    report.approximated(volume.name, "its grid cannot be read without the Python module openvdb: shown as a uniform "
                                     "box")
    return shaded_medium(volume.name, box_around(volume.instance.matrix, volume.box), lambda points: coefficients(
        points, lambda name: np.ones((*points.shape[:3], 1), np.float32)), report)


class MeshVolume:
    """The inside of a closed mesh, for all its instances. corners: (n, 3, 3) in the frame of the object."""

    def __init__(self, name: str, corners: np.ndarray, material, texture_space: np.ndarray, report: Report):
        self.name, self.material, self.texture_space, self.report = name, material, texture_space, report
        self.corners = corners.reshape(-1, 3).astype(np.float64)
        self._coefficients: dict[tuple, tuple[np.ndarray, np.ndarray]] = {}  # those of all instances

    def at(self, instance: Instance) -> Medium:
        matrix = instance.matrix
        box = box_around(matrix, self.corners)
        local = ((self.corners @ matrix[:3, :3].T + matrix[:3, 3] - box.center) @ box.rotation
                 / np.maximum(box.size, 1e-30)).reshape(-1, 3, 3)
        to_object = np.linalg.pinv(matrix)

        def coefficients(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            inside = positions @ to_object[:3, :3].T + to_object[:3, 3]
            corners = inside[[0, 0, 0, -1], [0, 0, -1, 0], [0, -1, 0, 0]]
            where = len(positions), np.float32(corners.round(5)).tobytes()
            if where in self._coefficients:
                return self._coefficients[where]
            points = volume_points(inside, self.texture_space, instance)
            result = volume_coefficients(self.material, self.report, points)
            if not points.depends_on_instance:
                self._coefficients[where] = result
            return result

        def emission(positions: np.ndarray) -> np.ndarray:
            inside = positions @ to_object[:3, :3].T + to_object[:3, 3]
            return volume_emission(self.material, self.report, volume_points(inside, self.texture_space, instance))

        return shaded_medium(self.name, box, coefficients, self.report, lambda n: fill_voxels(local, n), emission)
