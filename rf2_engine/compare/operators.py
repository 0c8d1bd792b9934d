# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user does with the comparison: operators, and a gizmo to drag the line of the split with the mouse."""
from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from ..registering import classes
from ..runtime.running import ENGINE
from . import draw, events, export, overlay
from .state import comparison

REACH = 8  # pixels to either side of the line, at an interface scale of 1


class RENDERFORMER_OT_compare(bpy.types.Operator):
    """Show both pictures that are compared in the Image Editor, or only the one that its header names"""
    bl_idname = "renderformer_v2.compare"
    bl_label = "Compare"

    mode: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    def execute(self, context):
        settings = comparison.settings
        if self.mode:
            settings.mode = self.mode
        if not (self.mode and settings.show):
            settings.show = not settings.show
        return {"FINISHED"}


class RENDERFORMER_OT_render_reference(bpy.types.Operator):
    """Enable Cycles Reference, and render both pictures"""
    bl_idname = "renderformer_v2.render_reference"
    bl_label = "Render Cycles Reference"

    @classmethod
    def poll(cls, context):
        return context.scene.render.engine == ENGINE and not bpy.app.is_job_running("RENDER")

    def execute(self, context):
        context.scene.renderformer_v2.reference.use = True
        return bpy.ops.render.render("INVOKE_DEFAULT")


class RENDERFORMER_OT_compare_choose(bpy.types.Operator):
    """Open the sidebar, where A and B are chosen"""
    bl_idname = "renderformer_v2.compare_choose"
    bl_label = "Choose A and B"

    @classmethod
    def poll(cls, context):
        return context.area is not None and context.area.type == "IMAGE_EDITOR"

    def execute(self, context):
        context.space_data.show_region_ui = True
        events.open_tab_soon(context.area)
        return {"FINISHED"}


class RENDERFORMER_OT_compare_swap(bpy.types.Operator):
    """Exchange A and B"""
    bl_idname = "renderformer_v2.compare_swap"
    bl_label = "Swap A and B"

    def execute(self, context):
        a, b = comparison.settings.a, comparison.settings.b
        for name in ("kind", "slot", "image", "layer", "pass_name"):
            value_a, value_b = getattr(a, name), getattr(b, name)
            setattr(a, name, value_b)
            setattr(b, name, value_a)
        return {"FINISHED"}


class RENDERFORMER_OT_compare_refresh(bpy.types.Operator):
    """Read both pictures again and update the metrics"""
    bl_idname = "renderformer_v2.compare_refresh"
    bl_label = "Refresh"

    @classmethod
    def poll(cls, context):
        if bpy.app.is_job_running("RENDER"):
            cls.poll_message_set("Wait until the render has ended")
            return False
        return comparison.settings.show

    def execute(self, context):
        events.read()
        if comparison.message:
            self.report({"WARNING"}, comparison.message)
        return {"FINISHED"}


class RENDERFORMER_OT_compare_cancel(bpy.types.Operator):
    """Stop measuring"""
    bl_idname = "renderformer_v2.compare_cancel"
    bl_label = "Cancel"

    def execute(self, context):
        if comparison.measurement:
            comparison.measurement.cancel()
        return {"FINISHED"}


class RENDERFORMER_OT_compare_export(bpy.types.Operator, ExportHelper):
    """Save A, B, their difference and the FLIP map in one PNG file, and the metrics in a JSON file beside it"""
    bl_idname = "renderformer_v2.compare_export"
    bl_label = "Export Comparison"

    filename_ext = ".png"
    filter_glob: bpy.props.StringProperty(default="*.png", options={"HIDDEN"})

    @classmethod
    def poll(cls, context):
        if comparison.a is None:
            cls.poll_message_set("Enable Compare and choose two pictures first")
            return False
        if comparison.measurement and comparison.measurement.is_running:
            cls.poll_message_set("Wait until the metrics are computed")
            return False
        return True

    def execute(self, context):
        measurement = comparison.measurement
        if measurement is None or measurement.closeness is None:
            measurement = comparison.new_measurement()
            measurement.run()
        if measurement.closeness is None:
            self.report({"ERROR"}, measurement.error)
            return {"CANCELLED"}
        path = Path(bpy.path.abspath(bpy.path.ensure_ext(self.filepath, ".png")))
        try:
            export.write(path, context.scene, comparison.a, comparison.b, measurement, comparison.settings.gain)
        except (OSError, RuntimeError) as error:
            self.report({"ERROR"}, f"The comparison cannot be written to {path}: {error}")
            return {"CANCELLED"}
        self.report({"INFO"}, f"Wrote {path.name} and {path.with_suffix('.json').name}")
        return {"FINISHED"}


class RENDERFORMER_GT_split(bpy.types.Gizmo):
    bl_idname = "RENDERFORMER_GT_split"  # a gizmo gets the mouse before the active tool

    def draw(self, context):
        if self.is_highlight or self.is_modal:
            overlay.draw_split(context, 3)

    def test_select(self, context, location):
        _, y = context.region.view2d.region_to_view(*location)
        is_near = abs(location[0] - overlay.split_x(context)) < REACH * context.preferences.system.ui_scale
        return 0 if is_near and 0 <= y <= 1 else -1

    def invoke(self, context, event):
        self.before = comparison.settings.split
        return {"RUNNING_MODAL"}

    def modal(self, context, event, tweak):
        comparison.settings.split = context.region.view2d.region_to_view(event.mouse_region_x, 0)[0]
        return {"RUNNING_MODAL"}

    def exit(self, context, cancel):
        if cancel:
            comparison.settings.split = self.before


class RENDERFORMER_GGT_split(bpy.types.GizmoGroup):
    bl_idname = "RENDERFORMER_GGT_split"
    bl_label = "Split of the Comparison"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT", "SHOW_MODAL_ALL"}

    @classmethod
    def poll(cls, context):
        return draw.is_split(context)

    def setup(self, context):
        self.gizmos.new(RENDERFORMER_GT_split.bl_idname)


register, unregister = classes(
    RENDERFORMER_OT_compare, RENDERFORMER_OT_render_reference, RENDERFORMER_OT_compare_choose,
    RENDERFORMER_OT_compare_swap, RENDERFORMER_OT_compare_refresh,
    RENDERFORMER_OT_compare_cancel, RENDERFORMER_OT_compare_export, RENDERFORMER_GT_split, RENDERFORMER_GGT_split)
