# SPDX-License-Identifier: GPL-3.0-or-later
"""Both pictures while the reference grows: ours, as Blender shows it, and on its side the reference so far."""
from __future__ import annotations

import time

import bpy

from mathutils import Matrix

from ..cycles import growing as cycles_growing
from . import events, halves, shader
from .pictures import OURS, Credits
from .slots import render_slots
from .state import comparison

MODES = ("SPLIT", "SIDE")  # the others need the pixels of both
INTERVAL = 1.0             # seconds between two updates from Cycles


class GrowingReference:
    """The running reference as an Image Editor draws it. There is one: `growing_reference`."""

    def __init__(self):
        self.picture = None      # gpu.types.GPUOffScreen with the reference so far
        self._next_update = 0.0  # by time.perf_counter
        self._view = 0           # number of the view of stereoscopy in `picture`

    def is_drawn(self, context: bpy.types.Context) -> bool:
        """Whether this Image Editor shows the picture whose reference Cycles renders, and both are to be shown.

        The first time that an editor shows a render's reference, this offers the comparison.
        """
        running, image = cycles_growing.running(), context.space_data.image
        if running is None or image is None or image.type != "RENDER_RESULT":
            return False
        events.offer_reference()
        settings = comparison.settings
        return settings.show and settings.mode in MODES and self._is_shown(context, running)

    def is_ours(self, context: bpy.types.Context) -> bool:
        """Whether this Image Editor shows the picture whose light Cycles traces: there is nothing else to show yet."""
        running = cycles_growing.running(is_reference=False)
        return running is not None and self._is_shown(context, running)

    def _is_shown(self, context: bpy.types.Context, running: cycles_growing.CyclesPicture) -> bool:
        """Whether this Image Editor shows Combined of what is rendered."""
        space, user = context.space_data, context.space_data.image_user
        if space.image is None or space.image.type != "RENDER_RESULT":
            return False
        return (space.image.render_slots.active_index == render_slots.rendering
                and user.multilayer_pass == 0 and _shows_layer(space, context.scene, running.layer)
                and (_shows_rendered_view(space) or self.picture is not None and self._view == user.multilayer_view))

    def labels(self) -> tuple[str, str]:
        """Labels of our picture and of the reference so far."""
        running = cycles_growing.running()
        if running is None:  # it has just ended
            return OURS, "Cycles"
        samples = f"{running.samples()} of {running.target_samples} samples"
        seconds = Credits(seconds=time.perf_counter() - running.begin)
        return str(Credits(OURS, None, running.our_seconds)), f"Cycles, {samples}, {seconds}"

    def draw(self, image_buffer, program) -> None:
        """Draw it into the framebuffer of the image, with shader.create's `program`: a reference on its side."""
        self._update()
        if self.picture is None:
            return
        is_reference = cycles_growing.running() is not None
        begin, shift = comparison.settings.split if is_reference else 0.0, 0.0
        if is_reference and comparison.settings.mode == "SIDE":
            _, begin, shift = halves.find(bpy.context)
            erase_right_half(bpy.context, image_buffer)
        with image_buffer.bind():
            shader.draw(program, self.picture.texture_color, shift=shift, part=(begin, 0, 1, 1))

    def _update(self) -> None:
        """Take over what Cycles has rendered so far, at most once in an interval."""
        import gpu

        running = cycles_growing.running() or cycles_growing.running(is_reference=False)
        if (running is None or time.perf_counter() < self._next_update
                or not _shows_rendered_view(bpy.context.space_data)):
            return
        size = (running.width, running.height)
        if self.picture is None or (self.picture.width, self.picture.height) != size:
            self.forget()
            if max(size) > gpu.capabilities.max_texture_size_get():
                return
            self.picture = gpu.types.GPUOffScreen(*size, format="RGBA16F")
        with self.picture.bind(), gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
            gpu.state.active_framebuffer_get().clear(color=(0, 0, 0, 0))
            gpu.matrix.load_identity()
            gpu.matrix.load_projection_matrix(
                Matrix.Translation((-1, -1, 0)) @ Matrix.Diagonal((2 / running.width, 2 / running.height, 1, 1))
                @ Matrix.Translation((-running.left, -running.bottom, 0)))
            cycles_growing.draw(bpy.context)
        gpu.state.blend_set("NONE")
        self._view = cycles_growing.view()
        self._next_update = time.perf_counter() + INTERVAL

    def forget(self) -> None:
        """Free the picture; a graphics context must be active if there is one."""
        if self.picture is not None:
            self.picture.free()
        self.picture = None


growing_reference = GrowingReference()


def erase_right_half(context: bpy.types.Context, image_buffer) -> None:
    """Make room for B: of the image, which Blender draws wherever it is, and of the background."""
    sides = halves.find(context)
    with image_buffer.bind():
        shader.erase(sides.end_of_a, 1)
    shader.erase(sides.begin_b + sides.shift, 1 + sides.shift)


def _shows_layer(space: bpy.types.SpaceImageEditor, scene: bpy.types.Scene, name: str) -> bool:
    rendered = [scene.view_layers[0]] if scene.render.use_single_layer else [
        layer for layer in scene.view_layers if layer.use]
    number = space.image_user.multilayer_layer
    return len(rendered) < 2 or number < len(rendered) and rendered[number].name == name


def _shows_rendered_view(space: bpy.types.SpaceImageEditor) -> bool:
    """Whether this Image Editor shows the view of stereoscopy that is being rendered; in 3D it shows the first."""
    return space.image_user.multilayer_view == cycles_growing.view()
