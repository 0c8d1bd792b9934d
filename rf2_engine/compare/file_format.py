# SPDX-License-Identifier: GPL-3.0-or-later
"""Change the scene's file format for a moment: `Image.save_render` reads it from there only."""
from __future__ import annotations

from contextlib import contextmanager
from operator import attrgetter

import bpy

from .. import compat

RESTORED = ("media_type", "file_format", "color_mode", "color_depth", "exr_codec", "compression", "color_management",
            "use_exr_interleave", "views_format")  # in this order: a format decides what the later ones may be
# Where Color Management is Override: Blender resets them with the format, and when it becomes Override again.
OVERRIDDEN = ("linear_colorspace_settings.name", "display_settings.display_device", "view_settings.view_transform",
              "view_settings.look", "view_settings.exposure", "view_settings.gamma")


@contextmanager
def file_format(scene: bpy.types.Scene, name: str, colorspace: str = "", **settings):
    """Inside, the scene saves files of this format with these image settings, linear ones in this color space."""
    image_settings = scene.render.image_settings
    is_override = image_settings.color_management == "OVERRIDE"
    before = {key: attrgetter(key)(image_settings) for key in RESTORED + OVERRIDDEN * is_override
              if hasattr(image_settings, key.partition(".")[0])}
    try:
        compat.set_file_format(image_settings, name)
        for key, value in settings.items():
            setattr(image_settings, key, value)
        if colorspace and is_override:
            image_settings.linear_colorspace_settings.name = colorspace
        yield
    finally:
        for key, value in before.items():
            if value != attrgetter(key)(image_settings):
                owner, _, last = key.rpartition(".")
                setattr(getattr(image_settings, owner) if owner else image_settings, last, value)
