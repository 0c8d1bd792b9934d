# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera Properties: what of Cycles' camera does not act yet, and says so."""
from __future__ import annotations

import bpy
from bl_ui.properties_data_camera import DATA_PT_lens

from ..setup.display import draw_text
from .panel import EnginePanel


class RENDERFORMER_PT_depth_of_field(EnginePanel):
    bl_label = "Depth of Field"
    bl_context = "data"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return context.camera and super().poll(context)

    def draw_header(self, context):
        row = self.layout.row()
        row.active = False
        row.prop(context.camera.dof, "use_dof", text="")

    def draw(self, context):
        layout, lens = self.split_layout(), context.camera.dof
        draw_text(layout, "This engine shows everything in focus", icon="INFO")
        column = layout.column()
        column.active = False
        column.prop(lens, "focus_object")
        column.prop(lens, "focus_distance")
        column.prop(lens, "aperture_fstop")


def draw_lens(self, context) -> None:
    """Below Blender's own settings of the lens."""
    if EnginePanel.poll(context) and context.camera.type not in {"PERSP", "ORTHO"}:
        draw_text(self.layout, "This engine has no such camera: set Type to Perspective or Orthographic")


_register, _unregister = bpy.utils.register_classes_factory((RENDERFORMER_PT_depth_of_field,))


def register() -> None:
    _register()
    DATA_PT_lens.append(draw_lens)


def unregister() -> None:
    DATA_PT_lens.remove(draw_lens)
    _unregister()
