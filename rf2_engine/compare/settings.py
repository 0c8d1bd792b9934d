# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the comparison: `window_manager.renderformer_v2_compare`. They are not saved in files."""
from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..registering import classes, pairs, pointer
from . import events
from .state import comparison


def _read_again(settings, context):
    events.choose()


def _redraw(settings, context):
    events.redraw()


def _change_mode(settings, context):
    events.redraw()
    events.fit_soon()


def _switch(settings, context):
    events.switch(settings.show)


def _layers(side, context, text):
    return sorted({layer for layer, _ in comparison.known_passes(side)})


def _passes(side, context, text):
    return sorted({name for layer, name in comparison.known_passes(side) if side.layer in ("", layer)})


class Side(bpy.types.PropertyGroup):
    """A or B."""

    kind: EnumProperty(name="From", update=_read_again, description="Source of the picture", items=(
        ("SHOWN", "Render Result", "The render slot that is shown in the Image Editor"),
        ("SLOT", "Render Slot", "Any render slot"),
        ("IMAGE", "Image", "A loaded image. All passes of a multilayer EXR file can be used")))
    slot: IntProperty(name="Slot", default=1, min=1, update=_read_again, description="Number of the render slot")
    image: StringProperty(name="Image", update=_read_again, description="A loaded image")
    layer: StringProperty(name="Layer", update=_read_again, search=_layers,
                          description="View layer. If empty, the one that the header shows")
    pass_name: StringProperty(name="Pass", update=_read_again, search=_passes,
                              description="Render pass, named as in the Image Editor. If empty, the one that the "
                                          "header shows")


class CompareSettings(bpy.types.PropertyGroup):
    show: BoolProperty(name="Compare", update=_switch,
                       description="Draw the comparison over the image. The image itself does not change")
    a: PointerProperty(type=Side)
    b: PointerProperty(type=Side)
    mode: EnumProperty(name="Mode", default="SPLIT", update=_change_mode, items=(
        ("SIDE", "Side by Side", "A in the left half of the editor, the same part of B in the right one"),
        ("SPLIT", "Split", "A to the left of a line, B to its right; drag the line with the mouse"),
        ("BLINK", "Blink", "A and B alternately"),
        ("DIFFERENCE", "Difference", "The absolute difference in scene-linear colors"),
        ("FLIP", "FLIP", "How visible the difference is when flipping between A and B")))
    split: FloatProperty(name="Split", default=0.5, min=0, max=1, subtype="FACTOR", update=_redraw,
                         description="Position of the dividing line, from left to right")
    gain: FloatProperty(name="Gain", default=5, min=0, soft_max=100, update=_redraw,
                        description="Factor that the difference is multiplied by. The paper shows 5")
    interval: FloatProperty(name="Interval", default=0.5, min=0.05, soft_max=5, subtype="TIME", unit="TIME_ABSOLUTE",
                            description="Time for which each picture is shown")
    region: EnumProperty(name="Measure", update=_read_again, items=(
        ("WHOLE", "Whole Picture", "Compute the metrics of all pixels that were rendered"),
        ("BORDER", "Render Region", "Compute the metrics inside the render region. Use View > Render Region to set "
                                    "it")))


register, unregister = pairs(
    classes(Side, CompareSettings), pointer(bpy.types.WindowManager, "renderformer_v2_compare", CompareSettings))
