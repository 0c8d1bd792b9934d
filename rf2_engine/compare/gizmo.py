# SPDX-License-Identifier: GPL-3.0-or-later
"""Drag the line of the split. A gizmo, because it gets the mouse before the active tool."""
from __future__ import annotations

import bpy

from ..registering import classes
from . import comparison, draw, overlay

REACH = 8  # pixels to either side at an interface scale of 1


class RENDERFORMER_GT_split(bpy.types.Gizmo):
    bl_idname = "RENDERFORMER_GT_split"

    def draw(self, context):
        if self.is_highlight or self.is_modal:
            overlay.draw_split(context, 3)

    def test_select(self, context, location):
        _, y = context.region.view2d.region_to_view(*location)
        near = abs(location[0] - overlay.split_x(context)) < REACH * context.preferences.system.ui_scale
        return 0 if near and 0 <= y <= 1 else -1

    def invoke(self, context, event):
        self.before = comparison.settings().split
        return {"RUNNING_MODAL"}

    def modal(self, context, event, tweak):
        comparison.settings().split = context.region.view2d.region_to_view(event.mouse_region_x, 0)[0]
        return {"RUNNING_MODAL"}

    def exit(self, context, cancel):
        if cancel:
            comparison.settings().split = self.before


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


register, unregister = classes(RENDERFORMER_GT_split, RENDERFORMER_GGT_split)
