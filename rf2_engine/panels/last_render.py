# SPDX-License-Identifier: GPL-3.0-or-later
"""Last Render: what the view layers of the last frame were made of, and what the picture lacks, by object."""
from __future__ import annotations

import bpy

from .. import statistics
from ..setup.display import draw_text
from .panel import EnginePanel

ICONS = {"approximated": "INFO", "skipped": "ERROR", "refused": "CANCEL"}


class RENDERFORMER_PT_report(EnginePanel):
    bl_label = "Last Render"
    bl_context = "render"
    bl_parent_id = "RENDERFORMER_PT_settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        column = self.layout.column(align=True)
        if not statistics.last_frame:
            column.label(text="Nothing was rendered yet")
        for i, layer in enumerate(statistics.last_frame):
            if len(statistics.last_frame) > 1:
                if i:
                    column.separator()
                column.label(text=layer.layer, icon="RENDERLAYERS")
            _draw_statistics(column, layer, context.scene)


def _draw_statistics(column, layer: statistics.LayerStatistics, scene: bpy.types.Scene) -> None:
    if layer.cancelled:
        column.label(text="Cancelled", icon="CANCEL")
        return
    if layer.error:
        draw_text(column, layer.error)
        return
    column.label(text=f"{layer.triangles} triangles, {layer.tokens} tokens")
    for stage, seconds in layer.seconds.items():
        column.label(text=f"{stage}: {seconds:.2f} s")
    for remark in layer.remarks:
        if users(scene, remark.name):
            row = column.row()
            row.alignment = "LEFT"
            select = row.operator("renderformer_v2.select_reported", text=remark.name, icon="RESTRICT_SELECT_OFF",
                                  emboss=False)
            select.name, select.remark = remark.name, str(remark)
            draw_text(column, f"{remark.kind}: {remark.message}", icon=ICONS[remark.kind])
        else:
            draw_text(column, str(remark), icon=ICONS[remark.kind])


def users(scene: bpy.types.Scene, name: str) -> list[bpy.types.Object]:
    """The object of that name, or else those that show the material or the data of that name."""
    if found := scene.objects.get(name):
        return [found]
    return [each for each in scene.objects
            if each.data and each.data.name == name
            or any(slot.material and slot.material.name == name for slot in each.material_slots)]


class RENDERFORMER_OT_select_reported(bpy.types.Operator):
    bl_idname = "renderformer_v2.select_reported"
    bl_label = "Select"
    bl_description = "Select what the report speaks of"
    bl_options = {"UNDO", "INTERNAL"}

    name: bpy.props.StringProperty(options={"SKIP_SAVE"})
    remark: bpy.props.StringProperty(options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT"

    @classmethod
    def description(cls, context, properties):
        return f"Select it. {properties.remark}"

    def execute(self, context):
        found = [each for each in users(context.scene, self.name) if each.name in context.view_layer.objects]
        shown = [each for each in found if each.visible_get()]
        if not shown:
            self.report({"WARNING"}, f'"{self.name}" is hidden, or not in this view layer')
            return {"CANCELLED"}
        for each in context.selected_objects:
            each.select_set(False)
        for each in shown:
            each.select_set(True)
        context.view_layer.objects.active = shown[0]
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((RENDERFORMER_PT_report, RENDERFORMER_OT_select_reported))
