# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects: OpenVDB grids as media (docs/scene-input.md 5.3, 5.5)."""
from __future__ import annotations

import importlib.machinery
import importlib.util
import tempfile
from pathlib import Path

import numpy as np

from .medium import CELLS, VOXELS, Medium, box_around


def volume_medium(obj, matrix: np.ndarray, scattering, absorption, report) -> Medium | None:
    """The density grid of an evaluated Volume object; None (and a remark) if it has none.

    matrix: (4, 4) object to world; coefficients (3,) as the shader gives them at density 1.
    """
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    # In render space OBJECT Cycles divides the coefficients by the root mean square of the scale.
    unit = 1 / max(np.sqrt(np.mean(scale ** 2)), 1e-30) if obj.data.render.space == "OBJECT" else 1.0
    scattering, absorption = np.asarray(scattering) * unit, np.asarray(absorption) * unit
    grid = _density_grid(obj.data)
    if grid is None:
        report.skipped(obj.name, "the volume has no grid of numbers named density, or its file cannot be read")
        return None
    openvdb = openvdb_module()
    if openvdb is None:
        report.approximated(obj.name, "its grid cannot be read without the openvdb module: shown as a uniform box")
        rotation, center, size = box_around(matrix, np.array(obj.bound_box))
        return Medium(obj.name, rotation, center, size, scattering, absorption, lambda n: np.ones((n,) * 3, np.float32))
    values, first, factor = _read(openvdb, obj.data, grid)
    if values.size == 0:
        report.skipped(obj.name, "its density grid is empty")
        return None
    to_world = matrix @ np.array(grid.matrix_object, np.float64)
    # Cycles draws voxel i over [i, i + 1] of index space.
    corners = first + np.indices((2, 2, 2)).reshape(3, 8).T * (np.array(values.shape) * factor)
    rotation, center, size = box_around(to_world, corners)
    to_index = np.linalg.inv(to_world)

    def density(resolution: int) -> np.ndarray:
        index = medium.points(resolution) @ to_index[:3, :3].T + to_index[:3, 3]
        return _trilinear(values, (index - first) / factor - 0.5)

    medium = Medium(obj.name, rotation, center, size, scattering, absorption, density)
    return medium


def _density_grid(volume):
    volume.grids.load()
    scalar = [grid for grid in volume.grids if grid.data_type in {"FLOAT", "DOUBLE"}]
    return next((grid for grid in scalar if grid.name == "density"), scalar[0] if scalar else None)


def _read(openvdb, volume, grid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Dense values, index of the first voxel (3,) and voxels per value (3,); large grids are averaged while read."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "grids.vdb")
        volume.grids.save(filepath=path)
        tree = openvdb.read(path, grid.name)
    if tree.activeVoxelCount() == 0:
        return np.zeros((0, 0, 0), np.float32), np.zeros(3), np.ones(3)
    low, high = (np.array(corner) for corner in tree.evalActiveVoxelBoundingBox())
    extent = high - low + 1
    factor = np.maximum(extent // (CELLS * VOXELS), 1)
    shape = -(-extent // factor)
    values = np.empty(shape, np.float32)
    slab = np.empty((factor[0], *(shape * factor)[1:]), np.float32)
    for i in range(shape[0]):
        tree.copyToArray(slab, ijk=tuple(int(v) for v in low + (i * factor[0], 0, 0)))
        values[i] = slab.reshape(factor[0], shape[1], factor[1], shape[2], factor[2]).mean(axis=(0, 2, 4))
    return np.maximum(np.nan_to_num(values), 0), low.astype(np.float64), factor.astype(np.float64)


def _trilinear(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """`values` at fractional indices (..., 3); 0 outside."""
    padded = np.pad(values, 1)
    at = np.clip(at + 1, 0, np.array(padded.shape) - 1.001)
    base = at.astype(np.int64)
    part, result = at - base, 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, part, 1 - part).prod(axis=-1)
        result = result + weight * padded[tuple(np.moveaxis(base + corner, -1, 0))]
    return result.astype(np.float32)


def openvdb_module():
    """The openvdb module that comes with Blender, or None; the bpy wheel hides it in a folder of its own."""
    if importlib.util.find_spec("openvdb"):
        import openvdb
        return openvdb
    import bpy
    folder = Path(bpy.utils.resource_path("LOCAL")) / "python"
    for path in folder.glob("lib/**/openvdb*" + importlib.machinery.EXTENSION_SUFFIXES[0]):
        spec = importlib.util.spec_from_file_location("openvdb", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    return None
