# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of Rendered viewports: `scene.renderformer_v2.viewport`."""
from __future__ import annotations

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty


class RenderFormerViewportSettings(bpy.types.PropertyGroup):
    token_budget: IntProperty(
        name="Max Triangles", default=2048, min=256, soft_max=16384, max=1 << 20,
        description="Maximum triangles sent to the network for Rendered viewports. Fewer triangles react faster to "
                    "changes",
    )
    resolution: EnumProperty(
        name="Resolution", default="1",
        description="The finest picture of a viewport. Pictures of 1/8, 1/4 and 1/2 of its pixels along each side "
                    "come first",
        items=(("1", "Full", "All pixels of the viewport", 0), ("2", "1/2", "Half as many along each side", 1),
               ("4", "1/4", "A quarter along each side", 2), ("8", "1/8", "An eighth along each side", 3)),
    )
    time_limit: FloatProperty(
        name="Time Limit", default=10.0, min=0.0, soft_max=60.0, subtype="TIME_ABSOLUTE",
        description="Leave out finer pictures that are expected to take longer than this, in seconds. 0 sets no limit",
    )
