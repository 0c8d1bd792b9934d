# SPDX-License-Identifier: GPL-3.0-or-later
"""Write files that the research code reads: panoramas and densities of media (docs/scene-input.md 5.1, 5.5)."""
from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...model.scene import CELLS, VOXELS
from ..convert.copying.vdb import openvdb_module
from ..convert.data.medium import Medium

SIDE = CELLS * VOXELS
ACTIVE = 1e-7  # least density, because every voxel must be in the file


def write_panorama(file: Path, radiance: np.ndarray) -> None:
    """Write radiance (H, W, 3) f32, scene-linear, row 0 on top, as EXR. Raises OSError if Blender cannot."""
    height, width, _ = radiance.shape
    image = bpy.data.images.new("Panorama", width, height, float_buffer=True, is_data=True)
    try:
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., :3] = radiance[::-1]
        image.pixels.foreach_set(pixels.ravel())
        image.file_format = "OPEN_EXR"
        image.save(filepath=str(file))
    except RuntimeError as error:
        raise OSError(f"{file} cannot be written: {error}") from error
    finally:
        bpy.data.images.remove(image)


def write_density(file: Path, medium: Medium) -> float | None:
    """Write the grid "density", from 0 to 1 over the cube [-0.5, 0.5]^3; voxels are centred at their indices.

    Returns the density that 1 stands for; 0 for an empty medium, which has no file; None without openvdb.
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
