# SPDX-License-Identifier: GPL-3.0-or-later
"""View Layer Properties: overrides of the scene's settings."""
from __future__ import annotations

from ..registering import classes
from .panel import EnginePanel


class RENDERFORMER_PT_override(EnginePanel):
    bl_label = "Override"
    bl_context = "view_layer"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.split_layout()
        layout.prop(context.view_layer, "material_override", text="Material")
        layout.prop(context.view_layer, "world_override", text="World")
        layout.prop(context.view_layer.renderformer_v2, "samples")


register, unregister = classes(RENDERFORMER_PT_override)
