# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Preflight in Render Properties: what F12 will do."""
from __future__ import annotations

import bpy

from ..engine import RenderFormerEngine
from ..frame import preflight
from ..registering import classes
from ..setup.display import draw_text
from .panel import EnginePanel
from .remarks import draw_badges, draw_copy, draw_remarks


class RENDERFORMER_PT_preflight(EnginePanel):
    bl_label = "Preflight"
    bl_context = "render"
    bl_parent_id = "RENDERFORMER_PT_settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header_preset(self, context):
        if latest := preflight.last.get(context.scene.name):
            draw_badges(self.layout, latest.remarks)

    def draw(self, context):
        self.layout.operator("renderformer_v2.preflight", icon="VIEWZOOM")
        if latest := preflight.last.get(context.scene.name):
            column = self.layout.column(align=True)
            if latest.state != preflight.state_of(context.scene, context.scene.view_layers.get(latest.layer)
                                                  or context.view_layer):
                draw_text(column, "The settings have changed since: check again")
            for line in latest.lines:
                draw_text(column, line, icon="ERROR" if latest.error else "BLANK1")
            draw_remarks(self.layout, latest, context.scene)
            draw_copy(self.layout, "PREFLIGHT")


class RENDERFORMER_OT_preflight(bpy.types.Operator):
    bl_idname = "renderformer_v2.preflight"
    bl_label = "Check Scene"
    bl_description = ("Convert the scene without rendering it, to show how many triangles the network will get, how "
                      "long a render will take, and what will be approximated. Takes at most "
                      f"{preflight.LONGEST:.0f} seconds")
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        if context.mode.startswith("EDIT"):
            cls.poll_message_set("Leave Edit Mode first")
            return False
        return context.engine == RenderFormerEngine.bl_idname

    def execute(self, context):
        window_manager = context.window_manager
        context.scene.update_tag()  # what a script sets of Cycles' settings reaches no depsgraph by itself
        window_manager.progress_begin(0, 100)
        try:
            latest = preflight.run(context.evaluated_depsgraph_get(),
                                   lambda text, fraction: window_manager.progress_update(100 * fraction))
        finally:
            window_manager.progress_end()
        preflight.last[context.scene.name] = latest
        return {"FINISHED"}


register, unregister = classes(RENDERFORMER_PT_preflight, RENDERFORMER_OT_preflight)
