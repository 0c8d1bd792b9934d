# SPDX-License-Identifier: GPL-3.0-or-later
"""Material Properties: settings that Blender's own panels do not show for this engine."""
from ..registering import classes
from .panel import EnginePanel


class RENDERFORMER_PT_material_settings(EnginePanel):
    bl_label = "Settings"
    bl_context = "material"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return context.material and super().poll(context)

    def draw(self, context):
        layout = self.split_layout()
        layout.prop(context.material, "pass_index")
        layout.prop(context.material, "displacement_method", text="Displacement")
        layout.use_property_split = False  # its name would be cut at the usual width
        layout.prop(context.material, "use_transparent_shadow")


register, unregister = classes(RENDERFORMER_PT_material_settings)
