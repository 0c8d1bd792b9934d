# SPDX-License-Identifier: GPL-3.0-or-later
"""Both pictures while one of them grows: ours, which Blender shows, and on its side the reference so far."""
from __future__ import annotations

import time

import bpy

from mathutils import Matrix

from ..cycles import growing as cycles_growing
from . import comparison, credits, events, overlay, shader, windows

MODES = ("SPLIT", "SIDE")  # the others need the pixels of both
INTERVAL = 1.0             # seconds between two looks at what Cycles has

_shown = None  # the picture on the graphics card
_next = 0.0    # time of the next look
_of = 0        # the number of the view that it shows


def is_drawn(context: bpy.types.Context) -> bool:
    """Whether this Image Editor shows the picture beside which Cycles renders, and both are wanted.

    The first look at a render's reference asks for that.
    """
    running, space = cycles_growing.running(), context.space_data
    if running is None or space.image is None or space.image.type != "RENDER_RESULT":
        return False
    events.offer_both()
    chosen = comparison.settings()
    return (chosen.show and chosen.mode in MODES and space.image.render_slots.active_index == windows.rendering
            and space.image_user.multilayer_pass == 0 and _is_of_layer(space, context.scene, running.layer)
            and (_renders_view_of(space) or _shown is not None and _of == space.image_user.multilayer_view))


def _is_of_layer(space: bpy.types.SpaceImageEditor, scene: bpy.types.Scene, layer: str) -> bool:
    rendered = [scene.view_layers[0]] if scene.render.use_single_layer else [
        each for each in scene.view_layers if each.use]
    number = space.image_user.multilayer_layer
    return len(rendered) < 2 or number < len(rendered) and rendered[number].name == layer


def _renders_view_of(space: bpy.types.SpaceImageEditor) -> bool:
    """Whether the view of stereoscopy is rendered that this Image Editor shows; in 3D that is the first."""
    return space.image_user.multilayer_view == cycles_growing.view()


def labels() -> tuple[str, str]:
    """Of our picture, and of the reference so far."""
    running = cycles_growing.running()
    if running is None:  # it has just ended
        return credits.OURS, "Cycles"
    so_far = f"{running.samples()} of {running.wanted} samples"
    seconds = credits.Credits(seconds=time.perf_counter() - running.begin)
    return str(credits.Credits(credits.OURS, None, running.our_seconds)), f"Cycles, {so_far}, {seconds}"


def draw(scene_linear, program) -> None:
    """The reference on its side, into the framebuffer of the image, with shader.create's `program`."""
    _look()
    if _shown is None:
        return
    if comparison.settings().mode == "SIDE":
        shader.erase(1 + overlay.GAP)
        with scene_linear.bind():
            shader.draw(program, _shown.texture_color, shift=1 + overlay.GAP)
    else:
        with scene_linear.bind():
            shader.draw(program, _shown.texture_color, part=(comparison.settings().split, 0, 1, 1))


def forget() -> None:
    """Where a graphics context is active."""
    global _shown
    if _shown is not None:
        _shown.free()
    _shown = None


def _look() -> None:
    """Take over what Cycles has by now, but not at each of the many times that the editor is drawn."""
    import gpu
    global _shown, _next, _of

    running = cycles_growing.running()
    if running is None or time.perf_counter() < _next or not _renders_view_of(bpy.context.space_data):
        return
    size = (running.width, running.height)
    if _shown is None or (_shown.width, _shown.height) != size:
        forget()
        if max(size) > gpu.capabilities.max_texture_size_get():
            return
        _shown = gpu.types.GPUOffScreen(*size, format="RGBA16F")
    with _shown.bind(), gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        gpu.state.active_framebuffer_get().clear(color=(0, 0, 0, 0))
        gpu.matrix.load_identity()
        gpu.matrix.load_projection_matrix(Matrix.Translation((-1, -1, 0)) @ Matrix.Diagonal(
            (2 / running.width, 2 / running.height, 1, 1)) @ Matrix.Translation((-running.left, -running.bottom, 0)))
        cycles_growing.draw(bpy.context)
    gpu.state.blend_set("NONE")
    _of = cycles_growing.view()
    _next = time.perf_counter() + INTERVAL
