# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators of the panel, except Export."""
from __future__ import annotations

import bpy

from ..registering import classes
from . import comparison, events


class RENDERFORMER_OT_compare(bpy.types.Operator):
    """Show both pictures that are compared in the Image Editor, or only the one that its header names"""
    bl_idname = "renderformer_v2.compare"
    bl_label = "Compare"

    mode: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    def execute(self, context):
        settings = comparison.settings()
        if self.mode:
            settings.mode = self.mode
        if self.mode and settings.show:
            return {"FINISHED"}
        settings.show = not settings.show
        return {"FINISHED"}


class RENDERFORMER_OT_compare_swap(bpy.types.Operator):
    """Exchange A and B"""
    bl_idname = "renderformer_v2.compare_swap"
    bl_label = "Swap A and B"

    def execute(self, context):
        a, b = comparison.settings().a, comparison.settings().b
        for name in ("kind", "slot", "image", "layer", "pass_name"):
            of_a, of_b = getattr(a, name), getattr(b, name)
            setattr(a, name, of_b)
            setattr(b, name, of_a)
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
        return comparison.settings().show

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


register, unregister = classes(
    RENDERFORMER_OT_compare, RENDERFORMER_OT_compare_swap, RENDERFORMER_OT_compare_refresh,
    RENDERFORMER_OT_compare_cancel)
