# SPDX-License-Identifier: GPL-3.0-or-later
"""Change the scene's file format for a moment: `Image.save_render` reads it from there only."""
from __future__ import annotations

from contextlib import contextmanager
from operator import attrgetter

import bpy

from .. import compat

KEPT = ("media_type", "file_format", "color_mode", "color_depth", "exr_codec", "compression", "color_management",
        "use_exr_interleave", "views_format")  # what a format allows stands behind it
# Where Color Management is Override. Blender sets them anew with the format, or when it becomes Override once more.
OVERRIDDEN = ("linear_colorspace_settings.name", "display_settings.display_device", "view_settings.view_transform",
              "view_settings.look", "view_settings.exposure", "view_settings.gamma")


@contextmanager
def file_format(scene: bpy.types.Scene, name: str, colorspace: str = "", **settings):
    """Inside, the scene saves files of this format with these image settings; linear ones in that color space."""
    of_scene = scene.render.image_settings
    overrides = of_scene.color_management == "OVERRIDE"
    kept = {key: attrgetter(key)(of_scene) for key in KEPT + OVERRIDDEN * overrides
            if hasattr(of_scene, key.partition(".")[0])}
    try:
        compat.set_file_format(of_scene, name)
        for key, value in settings.items():
            setattr(of_scene, key, value)
        if colorspace and overrides:
            of_scene.linear_colorspace_settings.name = colorspace
        yield
    finally:
        for key, value in kept.items():
            if value != attrgetter(key)(of_scene):
                owner, _, last = key.rpartition(".")
                setattr(getattr(of_scene, owner) if owner else of_scene, last, value)
