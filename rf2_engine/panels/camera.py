# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera Properties: our settings, below those of Blender and Cycles."""
from __future__ import annotations

from ..registering import appended
from ..setup.display import draw_text
from .panel import EnginePanel


def draw_lens(self, context) -> None:
    """Below Blender's own settings of the lens."""
    if EnginePanel.poll(context) and context.camera.type not in {"PERSP", "ORTHO"}:
        draw_text(self.layout, "This camera type is not supported: set Type to Perspective or Orthographic")


def draw_lens_samples(self, context) -> None:
    """Below Cycles' own settings of the focus: how many samples there are, which is the scene's."""
    layout = self.layout
    layout.prop(context.scene.renderformer_v2, "lens_samples", text="Samples")
    if context.camera.dof.use_dof and context.scene.renderformer_v2.lens_samples == 1:
        draw_text(layout, "Everything is in focus: set Samples above 1 for blur", icon="INFO")


register, unregister = appended("DATA_PT_lens", draw_lens)
