# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the Cycles reference: `scene.renderformer_v2.reference`."""
from __future__ import annotations

from dataclasses import dataclass

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty

from .registering import classes


def _update_sockets(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """The Render Layers node shows the passes of the next render."""
    for view_layer in settings.id_data.view_layers:
        view_layer.update_render_passes()


class ReferenceSettings(bpy.types.PropertyGroup):
    # What decides about passes cannot be keyframed: sockets and files have the same in every frame.
    use: BoolProperty(
        name="Cycles Reference", options=set(), update=_update_sockets,
        description="After each picture, Cycles renders the same view layer into the pass Cycles Reference. Our "
                    "picture is on screen first, and stays if the reference is stopped with Esc",
    )
    samples: IntProperty(name="Samples", default=128, min=1, soft_max=4096, max=1 << 24,
                         description="Samples per pixel of the reference")
    time_limit: FloatProperty(name="Time Limit", default=0.0, min=0.0, step=100, subtype="TIME", unit="TIME_ABSOLUTE",
                              description="Stop the reference after this time and keep the samples rendered so far. 0 "
                                          "is no limit")
    use_denoising: BoolProperty(name="Denoise", default=True, description="Denoise the reference with OpenImageDenoise")
    use_light_passes: BoolProperty(
        name="Light Passes", options=set(), update=_update_sockets,
        description="Also keep Cycles' light passes: Cycles Diffuse Direct and so on, not denoised",
    )


@dataclass(frozen=True)
class FrameReference:
    """The reference of one frame, keyframes included; it outlives the evaluated scene that it was read from."""

    samples: int
    time_limit: float  # seconds; 0 is no limit
    denoise: bool
    light_passes: bool

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> FrameReference | None:
        """The settings of an evaluated scene; None if no reference is wanted."""
        chosen = scene.renderformer_v2.reference
        if not chosen.use:
            return None
        return cls(chosen.samples, chosen.time_limit, chosen.use_denoising, chosen.use_light_passes)


register, unregister = classes(ReferenceSettings)
