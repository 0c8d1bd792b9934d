# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Cycles Reference in Render Properties."""
from __future__ import annotations

from ..registering import classes
from .panel import EnginePanel


class RENDERFORMER_PT_reference(EnginePanel):
    bl_context = "render"
    bl_label = "Cycles Reference"
    bl_parent_id = "RENDERFORMER_PT_settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context):
        self.layout.prop(context.scene.renderformer_v2.reference, "use", text="")

    def draw(self, context):
        chosen = context.scene.renderformer_v2.reference
        column = self.split_layout().column()
        column.active = chosen.use
        column.prop(chosen, "samples")
        column.prop(chosen, "time_limit")
        column.prop(chosen, "use_denoising")
        column.prop(chosen, "use_light_passes")
        if hasattr(context.scene, "cycles"):  # Cycles is an add-on, too
            column.prop(context.scene.cycles, "device")


register, unregister = classes(RENDERFORMER_PT_reference)
