# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the comparison: `window_manager.renderformer_v2_compare`. They are not saved in files."""
from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..registering import classes, pairs, pointer
from . import comparison, events


def _read_again(settings, context):
    events.read_soon()


def _redraw(settings, context):
    events.redraw()


def _switch(settings, context):
    events.switch(settings.show)


def _layers(side, context, text):
    return sorted({layer for layer, _ in comparison.known_passes(side)})


def _passes(side, context, text):
    return sorted({name for layer, name in comparison.known_passes(side) if side.layer in ("", layer)})


class Side(bpy.types.PropertyGroup):
    """A or B."""

    kind: EnumProperty(name="From", update=_read_again, description="Where the picture comes from", items=(
        ("SHOWN", "Render Result", "The render slot that is shown"),
        ("SLOT", "Render Slot", "One of the render slots, shown or not"),
        ("IMAGE", "Image", "A loaded image: multilayer EXR files give any of their passes")))
    slot: IntProperty(name="Slot", default=1, min=1, update=_read_again, description="The first render slot is 1")
    image: StringProperty(name="Image", update=_read_again, description="A loaded image")
    layer: StringProperty(name="Layer", update=_read_again, search=_layers,
                          description="The view layer; empty for the first that has the pass")
    pass_name: StringProperty(name="Pass", default="Combined", update=_read_again, search=_passes,
                              description="The render pass by its name in the Image Editor")


class CompareSettings(bpy.types.PropertyGroup):
    show: BoolProperty(name="Compare", update=_switch,
                       description="Draw the comparison over the image. The image itself is not changed")
    a: PointerProperty(type=Side)
    b: PointerProperty(type=Side)
    mode: EnumProperty(name="Mode", default="SPLIT", update=_redraw, items=(
        ("SIDE", "Side by Side", "A where the image is, B to its right"),
        ("SPLIT", "Split", "A to the left of a line, B to its right; drag the line with the mouse"),
        ("BLINK", "Blink", "A and B in turn"),
        ("DIFFERENCE", "Difference", "The absolute difference in scene-linear colours"),
        ("FLIP", "FLIP", "How much of a difference an observer sees who flips between A and B")))
    split: FloatProperty(name="Split", default=0.5, min=0, max=1, subtype="FACTOR", update=_redraw,
                         description="Position of the dividing line, from left to right")
    gain: FloatProperty(name="Gain", default=1, min=0, soft_max=100, update=_redraw,
                        description="Factor that makes the difference brighter")
    interval: FloatProperty(name="Interval", default=0.5, min=0.05, soft_max=5, subtype="TIME", unit="TIME_ABSOLUTE",
                            description="How long each picture is shown")
    region: EnumProperty(name="Measure", update=_read_again, items=(
        ("WHOLE", "Whole Picture", "Metrics of all pixels"),
        ("BORDER", "Render Region", "Metrics inside the render region: View > Render Region selects it")))


register, unregister = pairs(
    classes(Side, CompareSettings), pointer(bpy.types.WindowManager, "renderformer_v2_compare", CompareSettings))
