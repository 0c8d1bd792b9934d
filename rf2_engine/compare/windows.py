# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of the frame that a render slot has: all of it, unless there was a render region."""
from __future__ import annotations

from typing import NamedTuple

import bpy
from bpy.app.handlers import persistent

from ..registering import handlers
from ..render_size import frame_size, render_region


class Window(NamedTuple):
    """Pixels of the frame, and those that a picture shows of it, from the bottom left."""

    width: int
    height: int
    left: int
    right: int
    bottom: int
    top: int

    @property
    def all(self) -> Window:
        """All of the picture, in its own pixels."""
        return whole(self.right - self.left, self.top - self.bottom)

    def selected(self, settings: bpy.types.RenderSettings) -> Window:
        """The part that the render region selects, as far as the picture shows it, in pixels of the picture."""
        left, right, bottom, top = render_region(self.width, self.height, settings)
        left, right = (min(max(x, self.left), self.right) - self.left for x in (left, right))
        bottom, top = (min(max(y, self.bottom), self.top) - self.bottom for y in (bottom, top))
        return self.all._replace(left=left, right=max(left, right), bottom=bottom, top=max(bottom, top))


_cropped: dict[int, Window] = {}   # by slot number
_bordered: dict[int, Window] = {}  # the same of renders that show all of the frame, and hold nothing elsewhere
rendering = 0  # index of the slot that the last render went into


def whole(width: int, height: int) -> Window:
    return Window(width, height, 0, width, 0, height)


def of_slot(slot: int | None, width: int, height: int) -> Window:
    """The window of a picture of this size that was read from a slot; None is no slot."""
    window = _cropped.get(slot)
    return window if window and window.all[:2] == (width, height) else whole(width, height)


def rendered_of_slot(slot: int | None, width: int, height: int) -> Window:
    """The part of a picture of this size that was rendered, in its pixels."""
    part = _bordered.get(slot)
    return part if part and part[:2] == (width, height) else whole(width, height)


@persistent
def _begins(scene, *_):
    """Note what the slot that is shown will hold."""
    global rendering
    rendering = 0
    for image in bpy.data.images:
        if image.type == "RENDER_RESULT":
            rendering = image.render_slots.active_index
            _cropped.pop(slot := image.render_slots.active_index + 1, None)
            _bordered.pop(slot, None)
            if scene.render.use_border:
                width, height = frame_size(scene.render)
                of = _cropped if scene.render.use_crop_to_border else _bordered
                of[slot] = Window(width, height, *render_region(width, height, scene.render))


@persistent
def _loaded(*_):
    _cropped.clear()
    _bordered.clear()


register, unregister = handlers(("render_init", _begins), ("load_post", _loaded))
