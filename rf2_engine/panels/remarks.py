# SPDX-License-Identifier: GPL-3.0-or-later
"""How a report looks in a panel: how much of it there is, a line each, names that select, a copy as text."""
from __future__ import annotations

from weakref import WeakKeyDictionary

import bpy

from ..convert.report import Remark
from ..frame import preflight
from ..frame.preflight import Preflight
from ..progress import last_render
from ..progress.last_render import LayerStatistics
from ..registering import classes
from ..setup.display import draw_text

ICONS = {"approximated": "INFO", "skipped": "ERROR", "refused": "CANCEL"}

_selectable: WeakKeyDictionary[LayerStatistics | Preflight, dict[str, frozenset[str]]] = WeakKeyDictionary()


def draw_badges(layout: bpy.types.UILayout, remarks: list[Remark]) -> None:
    """How many remarks there are of each kind, by its icon; for the right end of a panel's header."""
    row = layout.row(align=True)
    for kind, icon in ICONS.items():
        if count := sum(remark.kind == kind for remark in remarks):
            row.label(text=str(count), icon=icon)


def draw_copy(layout: bpy.types.UILayout, source: str) -> None:
    layout.operator("renderformer_v2.copy_report", icon="COPYDOWN").source = source


def draw_remarks(layout: bpy.types.UILayout, report: LayerStatistics | Preflight, scene: bpy.types.Scene) -> None:
    names = selectable(report, scene)
    for remark in report.remarks:
        if remark.name in names:
            row = layout.row()
            row.alignment = "LEFT"
            select = row.operator("renderformer_v2.select_reported", text=remark.name, icon="RESTRICT_SELECT_OFF",
                                  emboss=False)
            select.name, select.remark = remark.name, str(remark)
            draw_text(layout, f"{remark.kind}: {remark.message}", icon=ICONS[remark.kind])
        else:
            draw_text(layout, str(remark), icon=ICONS[remark.kind])


def selectable(report: LayerStatistics | Preflight, scene: bpy.types.Scene) -> frozenset[str]:
    """The names in a report that something in the scene has, looked up when it is drawn first: panels draw often."""
    known = _selectable.setdefault(report, {})
    if scene.name not in known:
        names = {remark.name for remark in report.remarks}
        known[scene.name] = frozenset(names & _names(scene) if names else ())
    return known[scene.name]


def _names(scene: bpy.types.Scene) -> set[str]:
    """Of all objects, their data and their materials."""
    names = set()
    for each in scene.objects:
        names.add(each.name)
        if each.data:
            names.add(each.data.name)
        names.update(slot.material.name for slot in each.material_slots if slot.material)
    return names


def users(scene: bpy.types.Scene, name: str) -> list[bpy.types.Object]:
    """The object of that name, or else those that show the material or the data of that name."""
    if named := scene.objects.get(name):
        return [named]
    return [each for each in scene.objects
            if each.data and each.data.name == name
            or any(slot.material and slot.material.name == name for slot in each.material_slots)]


class RENDERFORMER_OT_select_reported(bpy.types.Operator):
    bl_idname = "renderformer_v2.select_reported"
    bl_label = "Select"
    bl_description = "Select the objects that this line is about"
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
        present = [each for each in users(context.scene, self.name) if each.name in context.view_layer.objects]
        shown = [each for each in present if each.visible_get()]
        if not shown:
            self.report({"WARNING"}, f'"{self.name}" is hidden, or not in this view layer')
            return {"CANCELLED"}
        for each in context.selected_objects:
            each.select_set(False)
        for each in shown:
            each.select_set(True)
        context.view_layer.objects.active = shown[0]
        return {"FINISHED"}


class RENDERFORMER_OT_copy_report(bpy.types.Operator):
    bl_idname = "renderformer_v2.copy_report"
    bl_label = "Copy as Text"
    bl_description = "Copy the report to the clipboard"
    bl_options = {"INTERNAL"}

    source: bpy.props.EnumProperty(items=(("LAST_RENDER", "Last Render", "", 0), ("PREFLIGHT", "Preflight", "", 1)),
                                   options={"SKIP_SAVE"})

    def execute(self, context):
        text = last_render.as_text() if self.source == "LAST_RENDER" else preflight.as_text(context.scene)
        context.window_manager.clipboard = text
        self.report({"INFO"}, f"Copied {len(text.splitlines())} lines")
        return {"FINISHED"}


register, unregister = classes(RENDERFORMER_OT_select_reported, RENDERFORMER_OT_copy_report)
