# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of Blender, Eevee and Cycles for this engine: some are shared with it, others copied.

A copy has the same content in our place and under our conditions: Cycles' panels check for Cycles by name, and
Blender's are registered before ours and would be above them.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator
from inspect import isfunction

import bpy
from bl_ui import properties_render

from ..engine import RenderFormerEngine
from ..frame_settings import traces_light
from ..registering import classes
from .camera import draw_lens_samples
from .panel import EnginePanel

# Panels that Blender shows for any engine, but which do nothing here, or which a more complete one replaces.
EXCLUDED = {
    "DATA_PT_preview", "TEXTURE_PT_preview",  # Blender hangs when a script changes the engine while one is drawn
    "DATA_PT_light", "NODE_DATA_PT_light", "DATA_PT_spot", "NODE_DATA_PT_spot", "DATA_PT_falloff_curve",
    "EEVEE_MATERIAL_PT_viewport_settings",
    "DATA_PT_lightprobe", "DATA_PT_lightprobe_visibility", "DATA_PT_lightprobe_parallax",
    "DATA_PT_lightprobe_display",
    "OBJECT_PT_visibility",
    "RENDER_PT_simplify", "RENDER_PT_simplify_viewport", "RENDER_PT_simplify_render",  # copied below
    "RENDER_PT_simplify_greasepencil",
}
EEVEE_PANELS = {
    "EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_volume", "EEVEE_MATERIAL_PT_displacement", "EEVEE_WORLD_PT_surface",
    "EEVEE_WORLD_PT_volume", "EEVEE_WORLD_PT_mist", "VIEWLAYER_PT_filter", "OBJECT_PT_shadow_terminator",
}
EEVEE_ENGINES = {"BLENDER_EEVEE", "BLENDER_EEVEE_NEXT"}  # the first from 5.0 on, the second up to 4.5
METHODS, ATTRIBUTES = ("draw", "draw_header", "draw_header_preset"), ("bl_label", "bl_context", "bl_options")


def shared_panels() -> Iterator[type[bpy.types.Panel]]:
    """Panels, built in or of other add-ons, whose settings this engine uses as well."""
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", ())
        if panel.__name__ in EEVEE_PANELS and EEVEE_ENGINES.intersection(engines):
            yield panel
        elif "BLENDER_RENDER" in engines and panel.__name__ not in EXCLUDED:
            yield panel


def copy_panel(panel: type, is_for: Callable[[bpy.types.Context], object], **attributes) -> type:
    """A panel class of ours that draws what `panel` does, wherever `is_for` holds; `attributes` replace its own."""
    inherited = {name: getattr(panel, name) for name in METHODS if isfunction(getattr(panel, name, None))}
    inherited |= {name: getattr(panel, name) for name in ATTRIBUTES if hasattr(panel, name)}
    if hasattr(panel, "bl_parent_id"):
        inherited["bl_parent_id"] = our_name(panel.bl_parent_id)
    prefix = "NODE_" if attributes.get("bl_space_type") == "NODE_EDITOR" else ""

    def poll(cls, context):
        return bool(EnginePanel.poll.__func__(cls, context) and is_for(context))
    return type(prefix + our_name(panel.__name__), (EnginePanel,),
                inherited | {"poll": classmethod(poll)} | attributes)


def our_name(name: str) -> str:
    """RENDERFORMER_LIGHT_PT_nodes for CYCLES_LIGHT_PT_nodes."""
    return f"RENDERFORMER_{name.partition('_')[2]}"


def find_original(name: str) -> type | None:
    """The panel of Blender or Cycles with that name; None where another version has renamed it."""
    try:
        from cycles import ui  # its module exists even where the add-on is switched off
    except ImportError:  # Blender was built without it
        ui = None
    return getattr(properties_render, name, None) or getattr(ui, name, None)


def _always(context) -> bool:
    return True


def _has_camera(context) -> object:
    return context.camera


def _has_light(context) -> object:
    return context.light


def _has_world(context) -> object:
    return context.world


def _has_traced_world(context) -> object:
    return context.world and traces_light(context.scene.renderformer_v2)


def _has_beam(context) -> bool:
    return context.light and context.light.type in {"SPOT", "AREA"}


def _can_be_visible(context) -> bool:
    return context.object and context.object.type not in {"CAMERA", "ARMATURE", "LATTICE", "SPEAKER", "LIGHT_PROBE"}


def _draw_focus(panel, context) -> None:
    find_original("CYCLES_CAMERA_PT_dof").draw(panel, context)
    draw_lens_samples(panel, context)


COPIED = (  # a panel, where it is shown, and what is different in ours; parents come before their children
    ("RENDER_PT_simplify", _always, {}),
    ("RENDER_PT_simplify_viewport", _always, {}),
    ("RENDER_PT_simplify_render", _always, {}),
    ("CYCLES_CAMERA_PT_dof", _has_camera, {"draw": _draw_focus, "bl_options": {"DEFAULT_CLOSED"}}),
    ("CYCLES_CAMERA_PT_dof_aperture", _has_camera, {}),
    ("CYCLES_RENDER_PT_motion_blur_curve", _always, {"bl_parent_id": "RENDERFORMER_PT_motion_blur"}),
    ("CYCLES_LIGHT_PT_light", _has_light, {}),
    ("CYCLES_LIGHT_PT_light", _has_light,  # in the Shader Editor's sidebar
     {"bl_space_type": "NODE_EDITOR", "bl_region_type": "UI", "bl_category": "Options"}),
    ("CYCLES_LIGHT_PT_beam_shape", _has_beam, {}),
    ("CYCLES_LIGHT_PT_nodes", _has_light, {"bl_options": {"DEFAULT_CLOSED"}}),
    ("CYCLES_OBJECT_PT_visibility", lambda context: context.object, {}),
    ("CYCLES_OBJECT_PT_visibility_ray_visibility", _can_be_visible, {}),
    ("CYCLES_OBJECT_PT_lightgroup", lambda context: context.object, {"bl_parent_id": "OBJECT_PT_shading"}),
    ("CYCLES_LIGHT_PT_settings", _has_light, {}),
    ("CYCLES_WORLD_PT_ray_visibility", _has_world, {}),
    ("CYCLES_WORLD_PT_settings", _has_world, {}),
    ("CYCLES_WORLD_PT_settings_surface", _has_traced_world, {}),
    ("CYCLES_WORLD_PT_settings_volume", _has_traced_world, {}),
    ("CYCLES_WORLD_PT_settings_light_group", _has_world, {}),
)


def create_copies() -> list[type]:
    """Copies of all COPIED panels that this version of Blender has, without the children of missing ones."""
    copies = {}
    for name, is_for, attributes in COPIED:
        panel = find_original(name)
        ours = panel and copy_panel(panel, is_for, **attributes)
        parent = getattr(ours, "bl_parent_id", "")
        if ours is None or parent and parent not in copies and not hasattr(bpy.types, parent):
            print(f"RenderFormer-V2: Blender {bpy.app.version_string} has no panel {name}, so it is not shown")
        else:
            copies[ours.__name__] = ours
    return list(copies.values())


registered_copies: list[type] = []


def register() -> None:
    copies = create_copies()
    classes(*copies)[0]()
    registered_copies[:] = copies
    for panel in shared_panels():
        panel.COMPAT_ENGINES.add(RenderFormerEngine.bl_idname)


def unregister() -> None:
    for panel in shared_panels():
        panel.COMPAT_ENGINES.discard(RenderFormerEngine.bl_idname)
    classes(*registered_copies)[1]()
    registered_copies.clear()
