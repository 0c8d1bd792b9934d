# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects, simulated gas, and meshes with a volume shader, as media."""
from __future__ import annotations

import numpy as np

from ..place import Place
from ..shading.volume import grid_names, has_volume, volume_coefficients, volume_points
from ..visibility import gas_domain
from .gas import gas_grids
from .grids import grid_medium
from .inside import filling
from .medium import Medium, box_around
from .shaded import shaded_medium
from .vdb import openvdb_module, read_grids

# What Cycles shades a Volume object without material with: Principled Volume, colour 0.5, density 1.
DEFAULT_GRID, DEFAULT_COEFFICIENT = "density", 0.5


def gridded(obj, material, place: Place, known: dict, report) -> Medium | None:
    """The grids of an evaluated Volume object or of a domain of gas; None, and a remark, if it shows none.

    known: what was read before.
    """
    domain = gas_domain(obj)
    if not has_volume(material) and (material or domain):
        report.skipped(obj.name, f'its material "{material.name}" has no volume shader' if material
                       else "it has no material with a volume shader")
        return None
    names, openvdb = grid_names(material) if material else [DEFAULT_GRID], openvdb_module()
    texture_space = np.float32(obj.bound_box)[[0, 6]]
    texture_space = np.stack([texture_space.mean(axis=0), np.ptp(texture_space, axis=0) / 2])
    # In render space OBJECT Cycles divides the coefficients by the root mean square of the scale.
    apart = domain or obj.data.render.space != "OBJECT"
    unit = 1.0 if apart else 1 / max(np.sqrt(np.mean(place.matrix[:3, :3] ** 2) * 3), 1e-30)

    def coefficients(inside, values):
        if material:
            points = volume_points(inside, texture_space, place, values)
            return [unit * c for c in volume_coefficients(material, report, points)]
        return [unit * DEFAULT_COEFFICIENT * values(DEFAULT_GRID) * np.ones(3)] * 2

    if openvdb is None and not domain:
        report.approximated(obj.name, "its grid cannot be read without the openvdb module: shown as a uniform box")
        box = box_around(place.matrix, np.array(obj.bound_box))
        return shaded_medium(obj.name, box, lambda points: coefficients(
            points, lambda name: np.ones((*points.shape[:3], 1), np.float32)), report)
    key = obj.as_pointer() if domain else obj.data.as_pointer(), *names
    if key not in known:
        known[key] = gas_grids(domain, obj, names) if domain else read_grids(openvdb, obj.data, names)
    grids = known[key]
    if grids:
        return grid_medium(obj.name, place.matrix, grids, coefficients, report)
    report.skipped(obj.name, f"it holds nothing called {' or '.join(names)}, which its shader asks for" if names
                   else "its shader asks for no grid: Cycles shows nothing either")
    return None


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
