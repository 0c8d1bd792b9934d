# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the density of a medium as the research code reads it (docs/scene-input.md 5.1, 5.5)."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from ...model.scene import CELLS, VOXELS
from ..convert.copying.vdb import openvdb_module
from ..convert.data.medium import Medium

SIDE = CELLS * VOXELS
ACTIVE = 1e-7  # least density: every voxel has to be there


def write_density(file: Path, medium: Medium) -> float | None:
    """The grid "density", from 0 to 1 over the cube [-0.5, 0.5]^3 (a voxel's index is its middle).

    Returns what 1 stands for, 0 for an empty medium, which makes no file; None without openvdb.
    """
    openvdb = openvdb_module()
    if openvdb is None:
        return None
    density = np.asarray(medium.density(SIDE), np.float64)
    peak = float(density.max())
    if peak <= 0:
        return 0.0
    grid = openvdb.FloatGrid()
    grid.copyFromArray(np.maximum(density / peak, ACTIVE).astype(np.float32))
    grid.name = "density"
    grid.transform = openvdb.createLinearTransform(voxelSize=1 / SIDE)
    grid.transform.postTranslate((-(SIDE - 1) / 2 / SIDE,) * 3)
    openvdb.write(str(file), grids=[grid])
    return peak
