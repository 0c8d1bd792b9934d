# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures that Blender reads: any file, and its own studio lights."""
from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np


def read_pixels(file: Path) -> np.ndarray:
    """(H, W, channels) f32, row 0 on top, of a file that is not kept open. Raises RuntimeError if Blender cannot."""
    image = bpy.data.images.load(str(file))
    try:
        width, height = image.size
        pixels = np.empty((height, width, image.channels), np.float32)
        image.pixels.foreach_get(pixels.ravel())
    finally:
        bpy.data.images.remove(image)
    return pixels[::-1]


def studio_light_file(name: str) -> Path:
    """One of Blender's studio lights, an equirectangular map in scene-linear radiance.

    Raises FileNotFoundError when this Blender was installed without its data files.
    """
    path = Path(bpy.utils.system_resource("DATAFILES")) / "studiolights" / "world" / f"{name}.exr"
    if not path.is_file():
        raise FileNotFoundError(f"studio light {path} is missing: install Blender with its data files")
    return path
