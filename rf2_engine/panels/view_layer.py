# SPDX-License-Identifier: GPL-3.0-or-later
"""View Layer Properties: a checkbox for each pass that the chosen weights can give, in Cycles' order; overrides."""
from __future__ import annotations

import bpy
from bl_ui.properties_view_layer import (
    ViewLayerAOVPanelHelper,
    ViewLayerCryptomattePanelHelper,
    ViewLayerLightgroupsPanelHelper,
)

from .. import passes
from ..frame_settings import light_passes
from ..registering import classes
from ..setup.display import draw_text
from .panel import EnginePanel


class _PassesPanel(EnginePanel):
    bl_context = "view_layer"


class RENDERFORMER_PT_passes(_PassesPanel):
    bl_label = "Passes"

    def draw(self, context):
        pass


class RENDERFORMER_PT_passes_data(_PassesPanel):
    bl_label = "Data"
    bl_parent_id = "RENDERFORMER_PT_passes"

    def draw(self, context):
        _draw_passes(self.layout, context.view_layer, available_passes(context.scene)["Data"])
        self.layout.prop(context.view_layer, "pass_alpha_threshold")


class RENDERFORMER_PT_passes_light(_PassesPanel):
    bl_label = "Light"
    bl_parent_id = "RENDERFORMER_PT_passes"

    def draw(self, context):
        for heading, rows in available_passes(context.scene).items():
            if heading != "Data":
                _draw_passes(self.layout, context.view_layer, rows, heading)
        if absent := passes.absent(context.scene, context.view_layer, light_passes(context.scene)):
            draw_text(self.layout, f"Enabled for Cycles, not available here: {', '.join(absent)}", icon="INFO")


class RENDERFORMER_PT_passes_cryptomatte(_PassesPanel, ViewLayerCryptomattePanelHelper, bpy.types.Panel):
    bl_parent_id = "RENDERFORMER_PT_passes"


class RENDERFORMER_PT_passes_aov(_PassesPanel, ViewLayerAOVPanelHelper, bpy.types.Panel):
    bl_parent_id = "RENDERFORMER_PT_passes"


def available_passes(scene: bpy.types.Scene) -> dict[str, dict[str, str]]:
    """{heading: {path of the view layer's property: label}} of the passes that the scene's settings allow."""
    rows, lighting = {}, light_passes(scene)
    for p in passes.PASSES:
        if p.setting and (p.source not in passes.OF_LIGHT or p.key in lighting):
            heading, label = p.heading
            rows.setdefault(heading, {}).setdefault(p.setting, label)
    rows["Data"]["use_pass_grease_pencil"] = "Grease Pencil"  # Blender itself renders it, with any engine
    return rows


def _draw_passes(layout: bpy.types.UILayout, view_layer: bpy.types.ViewLayer, rows: dict[str, str],
                 heading: str = "Include") -> None:
    layout.use_property_split, layout.use_property_decorate = True, False
    column = layout.column(heading=heading, align=True)
    for path, label in rows.items():
        owner, _, name = path.rpartition(".")
        settings = getattr(view_layer, owner, None) if owner else view_layer
        if settings is not None:
            column.prop(settings, name, text=label)


class RENDERFORMER_PT_passes_lightgroups(_PassesPanel, ViewLayerLightgroupsPanelHelper, bpy.types.Panel):
    bl_parent_id = "RENDERFORMER_PT_passes"

    def draw(self, context):
        ViewLayerLightgroupsPanelHelper.draw(self, context)
        self.layout.operator("renderformer_v2.add_light_group_mixer", icon="NODE_COMPOSITING")


class RENDERFORMER_PT_override(EnginePanel):
    bl_label = "Override"
    bl_context = "view_layer"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.split_layout()
        layout.prop(context.view_layer, "material_override", text="Material")
        layout.prop(context.view_layer, "world_override", text="World")
        layout.prop(context.view_layer.renderformer_v2, "samples")


register, unregister = classes(
    RENDERFORMER_PT_passes, RENDERFORMER_PT_passes_data, RENDERFORMER_PT_passes_light,
    RENDERFORMER_PT_passes_cryptomatte, RENDERFORMER_PT_passes_aov, RENDERFORMER_PT_passes_lightgroups,
    RENDERFORMER_PT_override)
