# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Cycles Reference in Render Properties."""
from __future__ import annotations

from ..frame import reference, reference_file
from ..registering import classes
from ..setup.display import draw_text
from .panel import EnginePanel

LIGHT_PATHS = ("max_bounces", "clamp_direct", "clamp_indirect", "use_caustics")


class RENDERFORMER_PT_reference(EnginePanel):
    bl_context = "render"
    bl_label = "Cycles Reference"
    bl_parent_id = "RENDERFORMER_PT_settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context):
        self.layout.prop(context.scene.renderformer_v2.reference, "use", text="")

    def draw(self, context):
        settings = context.scene.renderformer_v2.reference
        column = self.split_layout().column()
        column.active = settings.use
        if settings.use and reference.is_lost(context.scene):
            draw_text(column, f"Animations: {reference.LOST}")
        elif settings.use and reference_file.is_written(context.scene):
            draw_text(column, f"Animations: saved beside each frame, as NAME{reference_file.SUFFIX}", icon="INFO")
        samples = column.column()
        samples.active = not settings.use_scene_samples
        samples.prop(settings, "samples")
        column.prop(settings, "use_scene_samples")
        column.prop(settings, "time_limit")
        column.prop(settings, "use_denoising")
        if settings.use_denoising:
            column.prop(settings, "denoiser")
        column.prop(settings, "light_paths")
        if settings.light_paths == "OWN":
            for name in LIGHT_PATHS:
                column.prop(settings, name)
        column.operator("renderformer_v2.reference_as_in_paper")
        column.prop(settings, "use_light_passes")
        if hasattr(context.scene, "cycles"):  # Cycles is an add-on
            column.prop(context.scene.cycles, "device")


register, unregister = classes(RENDERFORMER_PT_reference)
