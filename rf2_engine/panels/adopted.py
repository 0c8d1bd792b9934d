# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of Blender and Eevee whose settings this engine uses too."""
from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..engine import RenderFormerEngine

# Panels that Blender shows for any engine but that do nothing here, or that a more complete one replaces.
EXCLUDED = {
    "DATA_PT_preview", "TEXTURE_PT_preview",  # Blender hangs when a script changes the engine while one is drawn
    "DATA_PT_light", "NODE_DATA_PT_light", "DATA_PT_spot", "NODE_DATA_PT_spot", "DATA_PT_falloff_curve",
    "EEVEE_MATERIAL_PT_viewport_settings",
    "DATA_PT_lightprobe", "DATA_PT_lightprobe_visibility", "DATA_PT_lightprobe_parallax",
    "DATA_PT_lightprobe_display",
    "OBJECT_PT_visibility",
    "RENDER_PT_simplify", "RENDER_PT_simplify_viewport", "RENDER_PT_simplify_render",  # copied.py
    "RENDER_PT_simplify_greasepencil",
}
OF_EEVEE = {
    "EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_volume", "EEVEE_MATERIAL_PT_displacement", "EEVEE_WORLD_PT_surface",
    "EEVEE_WORLD_PT_volume", "EEVEE_WORLD_PT_mist", "VIEWLAYER_PT_filter", "OBJECT_PT_shadow_terminator",
}
EEVEE_ENGINES = {"BLENDER_EEVEE", "BLENDER_EEVEE_NEXT"}  # the first from 5.0 on, the second up to 4.5


def panels() -> Iterator[type[bpy.types.Panel]]:
    """Blender's panels that make sense for this engine, built-in ones and those of other add-ons."""
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", ())
        if panel.__name__ in OF_EEVEE and EEVEE_ENGINES.intersection(engines):
            yield panel
        elif "BLENDER_RENDER" in engines and panel.__name__ not in EXCLUDED:
            yield panel


def register() -> None:
    for panel in panels():
        panel.COMPAT_ENGINES.add(RenderFormerEngine.bl_idname)


def unregister() -> None:
    for panel in panels():
        panel.COMPAT_ENGINES.discard(RenderFormerEngine.bl_idname)
