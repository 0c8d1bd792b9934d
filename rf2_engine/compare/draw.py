# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison drawn over the image, in every Image Editor that shows one of the two pictures.

The pictures are drawn into the buffer that Blender has just drawn the image into, scene-linear: view transform, look,
exposure and display are then Blender's own. Only the handler before the image finds that buffer bound.
"""
from __future__ import annotations

from functools import partial

import bpy
import numpy as np

from ...model.metrics.flip import magma
from ...model.pictures import srgb_to_linear
from ..cycles import growing as cycles_growing
from . import events, halves, overlay, shader
from .growing import erase_right_half, growing_reference
from .state import comparison


class GraphicsResources:
    """What the comparison holds on the graphics card."""

    def __init__(self):
        self.image_buffer = None   # the framebuffer of the image that is being drawn, scene-linear
        self._program = None
        self._textures: dict[str, object] = {}
        self._texture_source: tuple = ()  # generation and metrics that the textures show

    @property
    def program(self):
        if self._program is None:
            self._program = shader.create()
        return self._program

    def textures(self) -> dict[str, object]:
        """Textures "a" and "b" of the pictures, and "flip" of the FLIP map once it is computed."""
        metrics = comparison.measurement and comparison.measurement.closeness
        source = comparison.generation, id(metrics)
        if self._texture_source != source:
            if self._texture_source[:1] != source[:1]:
                self._textures = {"a": shader.texture(comparison.a.pixels), "b": shader.texture(comparison.b.pixels)}
            self._textures.pop("flip", None)
            if metrics:
                colors = srgb_to_linear(magma(metrics.flip_map))  # as the buffer over the image expects them
                self._textures["flip"] = shader.texture(np.pad(colors, ((0, 0), (0, 0), (0, 1)), constant_values=1))
            self._texture_source = source
        return self._textures


resources = GraphicsResources()
_handles: list = []


def is_drawn(context) -> bool:
    """Whether this Image Editor shows the comparison."""
    return comparison.is_shown() and comparison.uses(context.space_data.image)


def is_split(context) -> bool:
    """Whether there is a line to be dragged in this Image Editor."""
    return comparison.settings.mode == "SPLIT" and (is_drawn(context) or growing_reference.is_drawn(context))


def _before_image() -> None:
    import gpu
    resources.image_buffer = gpu.state.active_framebuffer_get()


def _after_image() -> None:
    import gpu
    if comparison.settings.show and comparison.is_outdated():
        events.read_soon()
    if growing_reference.is_drawn(bpy.context) or growing_reference.is_ours(bpy.context):
        growing_reference.draw(resources.image_buffer, resources.program)
    elif cycles_growing.running() is None:
        growing_reference.forget()
    if not is_drawn(bpy.context):
        return
    settings, textures = comparison.settings, resources.textures()
    show = partial(shader.draw, resources.program, opaque=bpy.context.space_data.display_channels == "COLOR")
    gpu.state.blend_set("NONE")
    if settings.mode == "SIDE":
        erase_right_half(bpy.context, resources.image_buffer)
    with resources.image_buffer.bind():
        if settings.mode == "SIDE":
            sides = halves.find(bpy.context)
            show(textures["a"], part=(0, 0, sides.end_of_a, 1))
            show(textures["b"], part=(sides.begin_b, 0, 1, 1), shift=sides.shift)
        elif settings.mode == "SPLIT":
            show(textures["a"], part=(0, 0, settings.split, 1))
            show(textures["b"], part=(settings.split, 0, 1, 1))
        elif settings.mode == "DIFFERENCE":
            show(textures["a"], textures["b"], gain=settings.gain)
        else:
            show(textures["b" if settings.mode == "BLINK" and comparison.blinks_to_b else "a"])
    if settings.mode == "FLIP" and "flip" in textures:  # its colours are a scale, not light
        area = comparison.measurement.box.area
        shader.draw(resources.program, textures["flip"], part=area, area=area)


def _over_image() -> None:
    context = bpy.context
    if growing_reference.is_drawn(context):
        overlay.draw(context, [growing_reference.labels()])
    elif is_drawn(context):
        overlay.draw(context, comparison.labels())
    elif comparison.settings.show and comparison.message and comparison.uses(context.space_data.image):
        overlay.draw_message(context, comparison.message)


def register() -> None:
    space = bpy.types.SpaceImageEditor
    for draw, moment in ((_before_image, "PRE_VIEW"), (_after_image, "POST_VIEW"), (_over_image, "POST_PIXEL")):
        _handles.append(space.draw_handler_add(draw, (), "WINDOW", moment))


def unregister() -> None:
    for handle in _handles:
        bpy.types.SpaceImageEditor.draw_handler_remove(handle, "WINDOW")
    _handles.clear()
    growing_reference.forget()
    resources.__init__()
