# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine that Blender sees: flags and delegations only."""
from __future__ import annotations

import bpy

from . import frame_settings, passes
from .frame import reference, render
from .registering import classes
from .runtime.running import ENGINE
from .viewport import viewport


class RenderFormerEngine(bpy.types.RenderEngine):
    bl_idname = ENGINE
    bl_label = "RenderFormer-V2"
    bl_use_postprocess = True             # the compositor runs on our passes
    bl_use_shading_nodes_custom = False   # Cycles' shader nodes stay in the Add menu
    bl_use_eevee_viewport = True          # Material Preview is Eevee's
    bl_use_preview = False
    bl_use_spherical_stereo = True        # its settings are shown, so that they can be switched off

    def update_render_passes(self, scene, view_layer):
        passes.register(self, scene, view_layer, frame_settings.light_passes(scene))
        reference.register_passes(self, scene, view_layer)

    def render(self, depsgraph):
        render.render(self, depsgraph)

    def view_update(self, context, depsgraph):
        viewport.update(self, context, depsgraph)

    def view_draw(self, context, depsgraph):
        viewport.draw(self, context, depsgraph)


register, unregister = classes(RenderFormerEngine)
