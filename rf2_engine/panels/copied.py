# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of Blender's and Cycles' panels for this engine: the same content, but our place and our conditions.

Cycles' panels check for Cycles by name, and Blender's were registered before ours and would be above them.
"""
from __future__ import annotations

from collections.abc import Callable
from inspect import isfunction

import bpy
from bl_ui import properties_render

from ..registering import classes as pair_of
from .camera import draw_lens_samples
from .panel import EnginePanel

METHODS = ("draw", "draw_header", "draw_header_preset")


def again(panel: type, is_for: Callable[[bpy.types.Context], object], **attributes) -> type:
    """A panel class of ours that draws what `panel` does where `is_for` says so; `attributes` replace its own."""
    kept = {name: getattr(panel, name) for name in METHODS if isfunction(getattr(panel, name, None))}
    kept |= {name: getattr(panel, name) for name in ("bl_label", "bl_context", "bl_options") if hasattr(panel, name)}
    if hasattr(panel, "bl_parent_id"):
        kept["bl_parent_id"] = our_name(panel.bl_parent_id)
    prefix = "NODE_" if attributes.get("bl_space_type") == "NODE_EDITOR" else ""

    def poll(cls, context):
        return bool(EnginePanel.poll.__func__(cls, context) and is_for(context))
    return type(prefix + our_name(panel.__name__), (EnginePanel,), kept | {"poll": classmethod(poll)} | attributes)


def our_name(name: str) -> str:
    """RENDERFORMER_LIGHT_PT_nodes for CYCLES_LIGHT_PT_nodes."""
    return f"RENDERFORMER_{name.partition('_')[2]}"


def original(name: str) -> type | None:
    """The panel of Blender or Cycles with that name; None where another version has renamed it."""
    try:
        from cycles import ui  # an add-on, which may be switched off: its module is there all the same
    except ImportError:  # Blender was built without it
        ui = None
    return getattr(properties_render, name, None) or getattr(ui, name, None)


def _always(context) -> bool:
    return True


def _has_camera(context) -> object:
    return context.camera


def _has_light(context) -> object:
    return context.light


def _has_beam(context) -> bool:
    return context.light and context.light.type in {"SPOT", "AREA"}


def _is_seen(context) -> bool:
    return context.object and context.object.type not in {"CAMERA", "ARMATURE", "LATTICE", "SPEAKER", "LIGHT_PROBE"}


def _draw_focus(panel, context) -> None:
    original("CYCLES_CAMERA_PT_dof").draw(panel, context)
    draw_lens_samples(panel, context)


WANTED = (  # a panel, where it is shown, and what is different in ours; those that others stand in come first
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
    ("CYCLES_OBJECT_PT_visibility_ray_visibility", _is_seen, {}),
    ("CYCLES_WORLD_PT_ray_visibility", lambda context: context.world, {}),
)


def copies() -> list[type]:
    """Ours of all that this version of Blender has. One that stands in a panel that is not there is left out too."""
    made = {}
    for name, is_for, attributes in WANTED:
        panel = original(name)
        ours = panel and again(panel, is_for, **attributes)
        parent = getattr(ours, "bl_parent_id", "")
        if ours is None or parent and parent not in made and not hasattr(bpy.types, parent):
            print(f"RenderFormer-V2: Blender {bpy.app.version_string} has no panel {name}, so it is not shown")
        else:
            made[ours.__name__] = ours
    return list(made.values())


classes: list[type] = []  # that are registered


def register() -> None:
    made = copies()
    pair_of(*made)[0]()
    classes[:] = made


def unregister() -> None:
    pair_of(*classes)[1]()
    classes.clear()
