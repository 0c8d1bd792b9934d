# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects, simulated gas, and meshes with a volume shader, as media."""
from __future__ import annotations

import numpy as np

from ..data.copied import Gridded
from ..data.instance import Place
from ..data.medium import Medium, box_around
from ..shading.volume import volume_coefficients, volume_points
from .grids import grid_medium
from .inside import filling
from .shaded import shaded_medium

# What Cycles shades a Volume object without material with: Principled Volume, colour 0.5, density 1.
DEFAULT_GRID, DEFAULT_COEFFICIENT = "density", 0.5


def gridded(it: Gridded, report) -> Medium:
    """The grids of a Volume object or of gas."""
    corners = np.float32(it.box)[[0, 6]]
    texture_space = np.stack([corners.mean(axis=0), np.ptp(corners, axis=0) / 2])
    unit = 1.0 if it.apart else 1 / max(np.sqrt(np.mean(it.place.matrix[:3, :3] ** 2) * 3), 1e-30)

    def coefficients(inside, values):
        if it.material:
            points = volume_points(inside, texture_space, it.place, values)
            return [unit * c for c in volume_coefficients(it.material, report, points)]
        return [unit * DEFAULT_COEFFICIENT * values(DEFAULT_GRID) * np.ones(3)] * 2

    if it.grids is not None:
        return grid_medium(it.name, it.place.matrix, it.grids, coefficients, report)
    report.approximated(it.name, "its grid cannot be read without the Python module openvdb: shown as a uniform box")
    return shaded_medium(it.name, box_around(it.place.matrix, it.box), lambda points: coefficients(
        points, lambda name: np.ones((*points.shape[:3], 1), np.float32)), report)


class MeshVolume:
    """The inside of a closed mesh, wherever it stands. corners: (n, 3, 3) in the frame of the object."""

    def __init__(self, name: str, corners: np.ndarray, material, texture_space: np.ndarray, report):
        self.name, self.material, self.texture_space, self.report = name, material, texture_space, report
        self.corners = corners.reshape(-1, 3).astype(np.float64)
        self._known: dict[tuple, tuple[np.ndarray, np.ndarray]] = {}  # coefficients that are those of all instances

    def at(self, place: Place) -> Medium:
        matrix = place.matrix
        box = box_around(matrix, self.corners)
        local = ((self.corners @ matrix[:3, :3].T + matrix[:3, 3] - box.center) @ box.rotation
                 / np.maximum(box.size, 1e-30)).reshape(-1, 3, 3)
        to_object = np.linalg.pinv(matrix)

        def coefficients(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            inside = places @ to_object[:3, :3].T + to_object[:3, 3]
            corners = inside[[0, 0, 0, -1], [0, 0, -1, 0], [0, -1, 0, 0]]
            where = len(places), np.float32(corners.round(5)).tobytes()
            if where in self._known:
                return self._known[where]
            points = volume_points(inside, self.texture_space, place)
            found = volume_coefficients(self.material, self.report, points)
            if not points.is_placed:
                self._known[where] = found
            return found

        return shaded_medium(self.name, box, coefficients, self.report, lambda n: filling(local, n))
