# SPDX-License-Identifier: GPL-3.0-or-later
"""Both pictures while one of them grows: ours, which Blender shows, and on its side the reference so far."""
from __future__ import annotations

import time

import bpy

from ..cycles import growing as cycles_growing
from ..setup import packages
from . import comparison, credits, overlay, shader, windows

MODES = ("SPLIT", "SIDE")  # the others need the pixels of both


def is_drawn(context: bpy.types.Context) -> bool:
    """Whether this Image Editor shows the picture beside which Cycles renders, and both are wanted."""
    running, space = cycles_growing.running(), context.space_data
    if running is None or space.image is None or space.image.type != "RENDER_RESULT":
        return False
    chosen, preferences = comparison.settings(), packages.preferences()
    wanted = chosen.show or preferences is None or preferences.show_reference
    return (wanted and chosen.mode in MODES and space.image.render_slots.active_index == windows.rendering
            and space.image_user.multilayer_pass == 0 and _is_of_layer(space, context.scene, running.layer))


def _is_of_layer(space: bpy.types.SpaceImageEditor, scene: bpy.types.Scene, layer: str) -> bool:
    rendered = [scene.view_layers[0]] if scene.render.use_single_layer else [
        each for each in scene.view_layers if each.use]
    number = space.image_user.multilayer_layer
    return len(rendered) < 2 or number < len(rendered) and rendered[number].name == layer


def labels() -> tuple[str, str]:
    """Of our picture, and of the reference so far."""
    running = cycles_growing.running()
    if running is None:  # it has just ended
        return credits.OURS, "Cycles"
    so_far = f"{running.samples()} of {running.wanted} samples"
    seconds = credits.Credits(seconds=time.perf_counter() - running.begin)
    return str(credits.Credits(credits.OURS, None, running.our_seconds)), f"Cycles, {so_far}, {seconds}"


def draw(context: bpy.types.Context, scene_linear) -> None:
    """The reference on its side, into the framebuffer of the image."""
    import gpu

    beside = comparison.settings().mode == "SIDE"
    shift = 1 + overlay.GAP if beside else 0.0
    running = cycles_growing.running()
    if running is None:
        return
    if beside:
        shader.erase(shift)
    with scene_linear.bind(), gpu.matrix.push_pop():
        gpu.state.scissor_test_set(True)
        left = 0 if beside else round(overlay.split_x(context))
        gpu.state.scissor_set(max(left, 0), 0, max(context.region.width - max(left, 0), 0), context.region.height)
        shader.erase(shift)  # where the reference is transparent ours would shine through
        gpu.matrix.translate((shift, 0))
        gpu.matrix.scale((1 / running.width, 1 / running.height))
        cycles_growing.draw(context)
        gpu.state.scissor_test_set(False)
        gpu.state.blend_set("NONE")
