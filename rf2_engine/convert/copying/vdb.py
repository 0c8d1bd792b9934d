# SPDX-License-Identifier: GPL-3.0-or-later
"""Grids of Volume objects, read with OpenVDB (docs/scene-input.md 5.3, 5.5)."""
from __future__ import annotations

import importlib.machinery
import importlib.util
import tempfile
from pathlib import Path

import numpy as np

from ....model.scene import CELLS, VOXELS
from ... import compat
from ..data.copied import Grid

NUMBERS, COLORS = {"FLOAT", "DOUBLE", "INT", "INT64"}, {"VECTOR_FLOAT", "VECTOR_DOUBLE"}


def read_grids(openvdb, volume, names: list[str]) -> dict[str, Grid]:
    """The grids of an evaluated Volume that have one of these names and are not empty."""
    volume.grids.load()
    readable = [grid for grid in volume.grids if grid.name in names and grid.data_type in NUMBERS | COLORS]
    grids = {}
    if readable:
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "grids.vdb")
            volume.grids.save(filepath=path)
            for grid in readable:
                tree = openvdb.read(path, grid.name)
                if tree.activeVoxelCount():
                    channels = 3 if grid.data_type in COLORS else 1
                    grids[grid.name] = _grid(tree, np.array(grid.matrix_object, np.float64), channels)
    return grids


def _grid(tree, to_object: np.ndarray, channels: int) -> Grid:
    """Dense values; large grids are averaged while they are read."""
    low, high = (np.array(corner) for corner in tree.evalActiveVoxelBoundingBox())
    extent = high - low + 1
    factor = np.maximum(extent // (CELLS * VOXELS), 1)
    shape = -(-extent // factor)
    values = np.empty((*shape, channels), np.float32)
    slab = np.empty((factor[0], *(shape * factor)[1:], channels)[:3 + (channels > 1)], np.float32)
    for i in range(shape[0]):
        tree.copyToArray(slab, ijk=tuple(int(v) for v in low + (i * factor[0], 0, 0)))
        values[i] = slab.reshape(factor[0], shape[1], factor[1], shape[2], factor[2], channels).mean(axis=(0, 2, 4))
    values = np.maximum(np.nan_to_num(values), 0)
    fades = np.array(shape) + 2 <= CELLS * VOXELS  # a coarse grid is interpolated to 0 outside of its values
    to_index = np.diag([*factor.astype(np.float64), 1.0])
    to_index[:3, 3] = low - fades * factor + compat.first_voxel_begins()
    return Grid(np.pad(values, [(int(fade), int(fade)) for fade in fades] + [(0, 0)]), to_object @ to_index)


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
