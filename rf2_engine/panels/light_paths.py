# SPDX-License-Identifier: GPL-3.0-or-later
"""Render Properties > Light Paths: those of Cycles' settings that act on a picture, most of them on traced light."""
from ..frame_settings import traces_light
from ..setup.display import draw_text
from .panel import EnginePanel

BOUNCES = {"max_bounces": "Total", "glossy_bounces": "Glossy", "transmission_bounces": "Transmission"}
NOISE = {"sample_clamp_direct": "Clamp Direct Light", "sample_clamp_indirect": "Clamp Indirect Light",
         "blur_glossy": "Filter Glossy"}
CAUSTICS = "caustics_reflective", "caustics_refractive"


class RENDERFORMER_PT_light_paths(EnginePanel):
    bl_label = "Light Paths"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, cycles = self.split_layout(), context.scene.cycles
        is_traced = traces_light(context.scene.renderformer_v2)
        bounces = layout.column(align=True, heading="Max Bounces")
        bounces.active = is_traced
        for name, label in BOUNCES.items():
            bounces.prop(cycles, name, text=label)
        layout.prop(cycles, "transparent_max_bounces", text="Transparent")
        noise = layout.column(align=True)
        noise.active = is_traced
        for name, label in NOISE.items():
            noise.prop(cycles, name, text=label)
        caustics = layout.column(align=True)
        for name in CAUSTICS:
            caustics.prop(cycles, name)
        if not is_traced:
            draw_text(layout, "Without Light: With Cycles, only Transparent and Caustics act", icon="INFO")
