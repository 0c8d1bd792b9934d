# SPDX-License-Identifier: GPL-3.0-or-later
"""A report in a panel: counts by kind, a line for each group of remarks, names that select objects, Copy as Text."""
from __future__ import annotations

import zlib
from weakref import WeakKeyDictionary

import bpy

from ..convert.data.report import Group, Remark, grouped
from ..frame import preflight
from ..frame.preflight import Preflight
from ..progress import last_render
from ..progress.last_render import LayerStatistics
from ..registering import classes
from ..setup.display import draw_text

ICONS = {"approximated": "INFO", "unplaced": "MESH_DATA", "skipped": "ERROR", "refused": "CANCEL"}

_selectable: WeakKeyDictionary[LayerStatistics | Preflight, dict[str, frozenset[str]]] = WeakKeyDictionary()


def draw_badges(layout: bpy.types.UILayout, remarks: list[Remark]) -> None:
    """Count the remarks of each kind, at the right end of a panel's header."""
    row = layout.row(align=True)
    for kind, icon in ICONS.items():
        if count := sum(remark.kind == kind for remark in remarks):
            row.label(text=str(count), icon=icon)


def draw_copy(layout: bpy.types.UILayout, source: str) -> None:
    layout.operator("renderformer_v2.copy_report", icon="COPYDOWN").source = source


def draw_remarks(layout: bpy.types.UILayout, report: LayerStatistics | Preflight, scene: bpy.types.Scene) -> None:
    """Draw remarks in the full width of a panel. Those that say the same are one line that opens to all names."""
    names = find_selectable(report, scene)
    for group in grouped(report.remarks):
        if len(group.remarks) > 1:
            _draw_group(layout, group, names)
            continue
        (remark,) = group.remarks
        if remark.name in names:
            _draw_select(layout, remark)
            draw_text(layout, f"{remark.kind}: {remark.message}", icon=ICONS[remark.kind])
        else:
            draw_text(layout, f"{remark.name}: {remark.message}", icon=ICONS[remark.kind])


def _draw_group(layout: bpy.types.UILayout, group: Group, names: frozenset[str]) -> None:
    identifier = zlib.crc32(f"{group.kind} {group.message}".encode())
    header, body = layout.panel(f"RENDERFORMER_{identifier}", default_closed=True)
    header.label(text=f"{len(group.remarks)} {group.kind}", icon=ICONS[group.kind])  # the message would be cut
    if body is None:
        draw_text(layout, f"{group.message}: {group.names}", icon="BLANK1")
        return
    draw_text(body, group.message, icon="BLANK1")
    for remark in group.remarks:
        if remark.name in names:
            _draw_select(body, remark)
        else:
            body.label(text=remark.name, icon="DOT")


def _draw_select(layout: bpy.types.UILayout, remark: Remark) -> None:
    row = layout.row()
    row.alignment = "LEFT"
    select = row.operator("renderformer_v2.select_reported", text=remark.name, icon="RESTRICT_SELECT_OFF", emboss=False)
    select.name, select.remark = remark.name, str(remark)


def find_selectable(report: LayerStatistics | Preflight, scene: bpy.types.Scene) -> frozenset[str]:
    """The names in a report that something in the scene has. Cached, because panels are drawn often."""
    cache = _selectable.setdefault(report, {})
    if scene.name not in cache:
        names = {remark.name for remark in report.remarks}
        cache[scene.name] = frozenset(names & _names(scene) if names else ())
    return cache[scene.name]


def _names(scene: bpy.types.Scene) -> set[str]:
    """Names of all objects, their data and their materials."""
    names = set()
    for obj in scene.objects:
        names.add(obj.name)
        if obj.data:
            names.add(obj.data.name)
        names.update(slot.material.name for slot in obj.material_slots if slot.material)
    return names


def find_users(scene: bpy.types.Scene, name: str) -> list[bpy.types.Object]:
    """The object of that name, or else those that show the material or the data of that name."""
    if named := scene.objects.get(name):
        return [named]
    return [obj for obj in scene.objects
            if obj.data and obj.data.name == name
            or any(slot.material and slot.material.name == name for slot in obj.material_slots)]


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
        users = [obj for obj in find_users(context.scene, self.name) if obj.name in context.view_layer.objects]
        visible = [obj for obj in users if obj.visible_get()]
        if not visible:
            self.report({"WARNING"}, f'"{self.name}" is hidden, or not in this view layer')
            return {"CANCELLED"}
        for obj in context.selected_objects:
            obj.select_set(False)
        for obj in visible:
            obj.select_set(True)
        context.view_layer.objects.active = visible[0]
        return {"FINISHED"}


class RENDERFORMER_OT_copy_report(bpy.types.Operator):
    bl_idname = "renderformer_v2.copy_report"
    bl_label = "Copy as Text"
    bl_description = "Copy the report to the clipboard"
    bl_options = {"INTERNAL"}

    source: bpy.props.EnumProperty(options={"SKIP_SAVE"}, items=(
        ("LAST_RENDER", "Last Render", "The report of the last frame, with all its view layers", 0),
        ("PREFLIGHT", "Preflight", "What Check Scene found", 1)))

    def execute(self, context):
        text = last_render.as_text() if self.source == "LAST_RENDER" else preflight.as_text(context.scene)
        context.window_manager.clipboard = text
        self.report({"INFO"}, f"Copied {len(text.splitlines())} lines")
        return {"FINISHED"}


register, unregister = classes(RENDERFORMER_OT_select_reported, RENDERFORMER_OT_copy_report)
