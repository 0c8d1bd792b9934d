# SPDX-License-Identifier: GPL-3.0-or-later
"""Write panoramas of radiance as EXR files, with Blender."""
from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np


def write_panorama(file: Path, radiance: np.ndarray) -> None:
    """(H, W, 3) f32, scene-linear, row 0 on top. Raises OSError if Blender cannot write the file."""
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
