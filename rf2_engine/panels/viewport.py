# SPDX-License-Identifier: GPL-3.0-or-later
"""Render Properties: how Rendered viewports are drawn."""
from __future__ import annotations

from ..registering import classes
from .panel import EnginePanel


class RENDERFORMER_PT_viewport(EnginePanel):
    bl_label = "Viewport"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, chosen = self.split_layout(), context.scene.renderformer_v2.viewport
        layout.prop(chosen, "token_budget")
        layout.prop(chosen, "resolution")
        layout.prop(context.scene.render, "preview_pixel_size", text="Pixel Size")
        layout.prop(chosen, "time_limit")


register, unregister = classes(RENDERFORMER_PT_viewport)
