# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's file format, borrowed: `Image.save_render` takes it from nowhere else."""
from __future__ import annotations

from contextlib import contextmanager

import bpy

from .. import compat

KEPT = ("media_type", "file_format", "color_mode", "color_depth", "exr_codec", "compression", "color_management",
        "use_exr_interleave")  # what a format allows stands behind it


@contextmanager
def file_format(scene: bpy.types.Scene, name: str, **settings):
    """Inside, the scene saves files of this format, with these image settings."""
    of_scene = scene.render.image_settings
    kept = {key: getattr(of_scene, key) for key in KEPT if hasattr(of_scene, key)}
    try:
        compat.set_file_format(of_scene, name)
        for key, value in settings.items():
            setattr(of_scene, key, value)
        yield
    finally:
        for key, value in kept.items():
            setattr(of_scene, key, value)
