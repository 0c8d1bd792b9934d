# SPDX-License-Identifier: GPL-3.0-or-later
"""Last Render: statistics of the view layers of the last frame, and the report by object."""
from __future__ import annotations

import bpy

from ..progress import last_render
from ..registering import classes
from ..setup.display import draw_text
from .panel import EnginePanel
from .remarks import draw_badges, draw_copy, draw_remarks


class RENDERFORMER_PT_report(EnginePanel):
    bl_label = "Last Render"
    bl_context = "render"
    bl_parent_id = "RENDERFORMER_PT_settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header_preset(self, context):
        draw_badges(self.layout, [remark for layer in last_render.last_frame for remark in layer.remarks])

    def draw(self, context):
        if not last_render.last_frame:
            self.layout.label(text="Rendering" if bpy.app.is_job_running("RENDER") else "No render yet")
            return
        for i, layer in enumerate(last_render.last_frame):
            if len(last_render.last_frame) > 1:
                if i:
                    self.layout.separator()
                self.layout.label(text=layer.layer, icon="RENDERLAYERS")
            _draw_statistics(self.layout, layer, context.scene)
        draw_copy(self.layout, "LAST_RENDER")


def _draw_statistics(layout, layer: last_render.LayerStatistics, scene: bpy.types.Scene) -> None:
    column = layout.column(align=True)
    if layer.cancelled:
        column.label(text="Cancelled", icon="CANCEL")
        return
    if layer.error:
        draw_text(column, layer.error)
        return
    column.label(text=f"{layer.triangles} triangles for the network")
    if layer.device:
        column.label(text=layer.device)
    for stage, seconds in layer.seconds.items():
        column.label(text=f"{stage}: {seconds:.2f} s")
    draw_remarks(layout, layer, scene)


register, unregister = classes(RENDERFORMER_PT_report)
