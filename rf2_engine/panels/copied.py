# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of Blender and Cycles once more, for this engine: what they draw is theirs, when and where is ours.

Cycles' panels ask for Cycles by name, and Blender's were registered before ours and would stand above them.
"""
from __future__ import annotations

from collections.abc import Callable
from inspect import isfunction

import bpy
from bl_ui import properties_render

from .camera import draw_lens_samples
from .panel import EnginePanel

METHODS = ("draw", "draw_header", "draw_header_preset")


def again(panel: type, is_for: Callable[[bpy.types.Context], object] = lambda context: True, **attributes) -> type:
    """A panel class of ours that draws what `panel` does where `is_for` says so; `attributes` replace its own."""
    kept = {name: getattr(panel, name) for name in METHODS if isfunction(getattr(panel, name, None))}
    kept |= {name: getattr(panel, name) for name in ("bl_label", "bl_context", "bl_options") if hasattr(panel, name)}
    if hasattr(panel, "bl_parent_id"):
        kept["bl_parent_id"] = our_name(panel.bl_parent_id)

    def poll(cls, context):
        return bool(EnginePanel.poll.__func__(cls, context) and is_for(context))
    return type(our_name(panel.__name__), (EnginePanel,), kept | {"poll": classmethod(poll)} | attributes)


def our_name(name: str) -> str:
    """RENDERFORMER_LIGHT_PT_nodes for CYCLES_LIGHT_PT_nodes."""
    return f"RENDERFORMER_{name.partition('_')[2]}"


def _has_beam(context) -> bool:
    return context.light and context.light.type in {"SPOT", "AREA"}


def _is_seen(context) -> bool:
    return context.object and context.object.type not in {"CAMERA", "ARMATURE", "LATTICE", "SPEAKER", "LIGHT_PROBE"}


def _classes() -> tuple[type, ...]:
    from cycles import ui  # an add-on, which may be switched off: its module is there all the same

    def draw_focus(panel, context):
        ui.CYCLES_CAMERA_PT_dof.draw(panel, context)
        draw_lens_samples(panel, context)
    light = again(ui.CYCLES_LIGHT_PT_light, lambda context: context.light)
    return (
        again(properties_render.RENDER_PT_simplify),
        again(properties_render.RENDER_PT_simplify_viewport),
        again(properties_render.RENDER_PT_simplify_render),
        again(ui.CYCLES_CAMERA_PT_dof, lambda context: context.camera, draw=draw_focus,
              bl_options={"DEFAULT_CLOSED"}),
        again(ui.CYCLES_CAMERA_PT_dof_aperture, lambda context: context.camera),
        again(ui.CYCLES_RENDER_PT_motion_blur_curve, bl_parent_id="RENDERFORMER_PT_motion_blur"),
        light, ui.node_panel(light),  # in Properties, and in the Shader Editor's sidebar
        again(ui.CYCLES_LIGHT_PT_beam_shape, _has_beam),
        again(ui.CYCLES_LIGHT_PT_nodes, lambda context: context.light, bl_options={"DEFAULT_CLOSED"}),
        again(ui.CYCLES_OBJECT_PT_visibility, lambda context: context.object),
        again(ui.CYCLES_OBJECT_PT_visibility_ray_visibility, _is_seen),
        again(ui.CYCLES_WORLD_PT_ray_visibility, lambda context: context.world),
    )


classes: list[type] = []


def register() -> None:
    classes[:] = _classes()
    for panel in classes:
        bpy.utils.register_class(panel)


def unregister() -> None:
    while classes:
        bpy.utils.unregister_class(classes.pop())
