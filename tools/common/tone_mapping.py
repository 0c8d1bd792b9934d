# SPDX-License-Identifier: GPL-3.0-or-later
"""Linear pictures for screens: Blender's view transforms, and the plain numbers that the authors' code writes."""
from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from renderformer_v2.model.pictures import linear_to_srgb

from .pictures import to_bytes

STANDARD, NONE = "standard", "none"  # the sRGB curve; nothing but clipping
VIEWS = {STANDARD: "Standard", NONE: "Raw", "agx": "AgX", "filmic": "Filmic",
         "pbr_neutral": "Khronos PBR Neutral"}  # Blender's, by our names
TONE_MAPPERS = tuple(VIEWS)


def tone_mapped(radiance: np.ndarray, mapper: str = STANDARD) -> np.ndarray:
    """(H, W, 3) u8 of scene-linear radiance (H, W, 3); mapper: one of TONE_MAPPERS."""
    if mapper == STANDARD:
        return to_bytes(linear_to_srgb(radiance))
    if mapper == NONE:
        return (np.clip(radiance, 0, 1) * 255).astype(np.uint8)
    return _blender_transform(radiance, VIEWS[mapper])


def _blender_transform(radiance: np.ndarray, name: str) -> np.ndarray:
    import bpy
    from skimage.io import imread

    from renderformer_v2.rf2_engine.compat import set_file_format
    height, width, _ = radiance.shape
    scene = bpy.data.scenes.new("Tone mapping")
    image = bpy.data.images.new("Radiance", width, height, float_buffer=True)
    try:
        scene.view_settings.view_transform, scene.render.dither_intensity = name, 0
        set_file_format(scene.render.image_settings, "PNG")
        scene.render.image_settings.color_mode = "RGB"
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., :3] = radiance[::-1]
        image.pixels.foreach_set(pixels.ravel())
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "shown.png")
            image.save_render(path, scene=scene)
            return imread(Path(path))[..., :3]
    finally:
        bpy.data.images.remove(image)
        bpy.data.scenes.remove(scene)
