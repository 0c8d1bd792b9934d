# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison drawn over the image, in every Image Editor that shows one of the two pictures.

The pictures are drawn into the buffer that Blender has just drawn the image into, scene-linear: view transform, look,
exposure and display are then Blender's own. Only the handler before the image finds that buffer bound.
"""
from __future__ import annotations

from functools import partial

import bpy
import numpy as np

from ...model.color import srgb_to_linear
from ...model.metrics.flip import magma
from ..cycles import growing as cycles_growing
from . import comparison, events, growing, overlay, shader

_shader = None
_textures: dict[str, object] = {}
_of: tuple = ()          # what the textures show
_scene_linear = None     # the framebuffer with the image
_handles: list = []


def is_drawn(context) -> bool:
    """Whether this Image Editor shows what is compared."""
    return comparison.is_shown() and comparison.is_compared(context.space_data.image)


def is_split(context) -> bool:
    """Whether there is a line to be dragged in this Image Editor."""
    return comparison.settings().mode == "SPLIT" and (is_drawn(context) or growing.is_drawn(context))


def _before_image() -> None:
    import gpu
    global _scene_linear
    _scene_linear = gpu.state.active_framebuffer_get()


def _after_image() -> None:
    import gpu
    if comparison.settings().show:
        events.look_again()
    if growing.is_drawn(bpy.context):
        growing.draw(_scene_linear, _program())
    elif cycles_growing.running() is None:
        growing.forget()
    if not is_drawn(bpy.context):
        return
    chosen, textures = comparison.settings(), _current_textures()
    show = partial(shader.draw, _program(), opaque=bpy.context.space_data.display_channels == "COLOR")
    gpu.state.blend_set("NONE")
    if chosen.mode == "SIDE":
        shader.erase(1 + overlay.GAP)
    with _scene_linear.bind():
        if chosen.mode == "SIDE":
            show(textures["a"])
            show(textures["b"], shift=1 + overlay.GAP)
        elif chosen.mode == "SPLIT":
            show(textures["a"], part=(0, 0, chosen.split, 1))
            show(textures["b"], part=(chosen.split, 0, 1, 1))
        elif chosen.mode == "DIFFERENCE":
            show(textures["a"], textures["b"], gain=chosen.gain)
        else:
            show(textures["b" if chosen.mode == "BLINK" and events.blink else "a"])
    if chosen.mode == "FLIP" and "flip" in textures:  # its colours are a scale, not light
        area = comparison.measurement.box.area
        shader.draw(_program(), textures["flip"], part=area, area=area)


def _over_image() -> None:
    context = bpy.context
    if growing.is_drawn(context):
        overlay.draw(context, [growing.labels()])
    elif is_drawn(context):
        overlay.draw(context, comparison.labels())
    elif comparison.settings().show and comparison.message and comparison.is_compared(context.space_data.image):
        overlay.say(context, comparison.message)


def _program():
    global _shader
    if _shader is None:
        _shader = shader.create()
    return _shader


def _current_textures() -> dict[str, object]:
    global _of
    measured = comparison.measurement and comparison.measurement.closeness
    now = comparison.generation, id(measured)
    if _of != now:
        if _of[:1] != now[:1]:
            _textures.clear()
            _textures.update(a=shader.texture(comparison.a.pixels), b=shader.texture(comparison.b.pixels))
        _textures.pop("flip", None)
        if measured:
            colors = srgb_to_linear(magma(measured.flip_map))  # as the buffer over the image wants them
            _textures["flip"] = shader.texture(np.pad(colors, ((0, 0), (0, 0), (0, 1)), constant_values=1))
        _of = now
    return _textures


def register() -> None:
    space = bpy.types.SpaceImageEditor
    for draw, when in ((_before_image, "PRE_VIEW"), (_after_image, "POST_VIEW"), (_over_image, "POST_PIXEL")):
        _handles.append(space.draw_handler_add(draw, (), "WINDOW", when))


def unregister() -> None:
    global _shader, _of, _scene_linear
    for handle in _handles:
        bpy.types.SpaceImageEditor.draw_handler_remove(handle, "WINDOW")
    _handles.clear()
    _textures.clear()
    growing.forget()
    _shader, _of, _scene_linear = None, (), None
