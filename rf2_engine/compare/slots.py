# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of the frame that each render slot holds: all of it, unless there was a render region."""
from __future__ import annotations

from typing import NamedTuple

import bpy
from bpy.app.handlers import persistent

from ..registering import handlers
from ..render_size import frame_size, render_region


class Crop(NamedTuple):
    """The size of a frame in pixels, and the pixels of it that a picture shows, from the bottom left."""

    width: int
    height: int
    left: int
    right: int
    bottom: int
    top: int

    @property
    def picture(self) -> Crop:
        """All of the picture, in its own pixels."""
        return full(self.right - self.left, self.top - self.bottom)

    def in_render_region(self, settings: bpy.types.RenderSettings) -> Crop:
        """The part inside the render region, as far as the picture shows it, in pixels of the picture."""
        left, right, bottom, top = render_region(self.width, self.height, settings)
        left, right = (min(max(x, self.left), self.right) - self.left for x in (left, right))
        bottom, top = (min(max(y, self.bottom), self.top) - self.bottom for y in (bottom, top))
        return self.picture._replace(left=left, right=max(left, right), bottom=bottom, top=max(bottom, top))


def full(width: int, height: int) -> Crop:
    return Crop(width, height, 0, width, 0, height)


class RenderSlots:
    """What the slots of the render result hold, by slot number from 1. There is one: `render_slots`."""

    def __init__(self):
        self.rendering = 0  # index of the slot that the last render went into
        self._cropped: dict[int, Crop] = {}  # renders whose picture is the region alone
        self._partial: dict[int, Crop] = {}  # renders whose picture is the frame, empty outside of the region

    def crop(self, slot: int | None, width: int, height: int) -> Crop:
        """The part of the frame that a picture of this size shows; slot None: no slot."""
        crop = self._cropped.get(slot)
        return crop if crop and crop.picture[:2] == (width, height) else full(width, height)

    def rendered(self, slot: int | None, width: int, height: int) -> Crop:
        """The part of a picture of this size that was rendered, in its pixels."""
        crop = self._partial.get(slot)
        return crop if crop and crop[:2] == (width, height) else full(width, height)

    def note(self, scene: bpy.types.Scene) -> None:
        """Note what a render that begins will leave in the slot that is shown."""
        self.rendering = 0
        for image in bpy.data.images:
            if image.type == "RENDER_RESULT":
                self.rendering = image.render_slots.active_index
                slot = self.rendering + 1
                self._cropped.pop(slot, None)
                self._partial.pop(slot, None)
                if scene.render.use_border:
                    width, height = frame_size(scene.render)
                    crops = self._cropped if scene.render.use_crop_to_border else self._partial
                    crops[slot] = Crop(width, height, *render_region(width, height, scene.render))

    def forget(self) -> None:
        self._cropped.clear()
        self._partial.clear()


render_slots = RenderSlots()


@persistent
def _note_slot(scene, *_):
    render_slots.note(scene)


@persistent
def _forget_slots(*_):
    render_slots.forget()


register, unregister = handlers(("render_init", _note_slot), ("load_post", _forget_slots))
