# SPDX-License-Identifier: GPL-3.0-or-later
"""The base class of our panels."""
import bpy

from ..engine import RenderFormerEngine


class EnginePanel(bpy.types.Panel):
    """Shown in the Properties editor while our engine is chosen, with labels and values in two columns."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"

    @classmethod
    def poll(cls, context):
        return context.engine == RenderFormerEngine.bl_idname

    def split_layout(self) -> bpy.types.UILayout:
        self.layout.use_property_split, self.layout.use_property_decorate = True, False
        return self.layout
