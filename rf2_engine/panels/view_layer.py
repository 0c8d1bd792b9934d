# SPDX-License-Identifier: GPL-3.0-or-later
"""View Layer Properties: passes, and what the layer shows instead of the scene's own."""
from __future__ import annotations

import bpy

from .. import passes
from ..setup.display import draw_text
from .panel import EnginePanel


class RENDERFORMER_PT_passes(EnginePanel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context):
        layout = self.split_layout()
        always = ", ".join(p.blender_name for p in passes.PASSES if not p.setting and p.source != "lighting")
        draw_text(layout, f"Always: {always}", icon="INFO")
        column = layout.column(heading="Data")
        for p in passes.PASSES:
            if p.setting:
                column.prop(context.view_layer, p.setting, text=p.name_5)


class RENDERFORMER_PT_override(EnginePanel):
    bl_label = "Override"
    bl_context = "view_layer"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.split_layout()
        layout.prop(context.view_layer, "material_override")
        layout.prop(context.view_layer, "world_override")


register, unregister = bpy.utils.register_classes_factory((RENDERFORMER_PT_passes, RENDERFORMER_PT_override))
