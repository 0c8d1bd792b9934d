# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of a running Cycles, as far as it is: drawn by Cycles itself, as in its own renders.

Cycles keeps it on the graphics card for that, in the window only, whether anybody looks or not, so drawing it costs
next to nothing.
"""
from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

import bpy


class CyclesPicture(NamedTuple):
    """The reference of a view layer, or the traced light of our own picture of it."""

    layer: str
    width: int                  # of the picture, in pixels
    height: int
    our_seconds: float
    samples: Callable[[], int]  # returns the samples so far
    target_samples: int
    begin: float                # by time.perf_counter
    left: int = 0               # of the render region in the frame, in pixels: Cycles draws it there
    bottom: int = 0
    views: tuple[str, ...] = ("",)  # of stereoscopy, which Cycles renders one after the other
    is_reference: bool = True


@dataclass
class GrowingPicture:
    """What Cycles renders now, if it can be drawn. The window is drawn by another thread than the one that renders."""

    picture: CyclesPicture | None = None
    engine: bpy.types.RenderEngine | None = None  # in whose session it is
    lock: threading.Lock = field(default_factory=threading.Lock)  # neither may go away while it is drawn


_growing = GrowingPicture()


@contextmanager
def announced(picture: CyclesPicture):
    """Announce that what Cycles renders inside is this picture."""
    _growing.picture = picture
    try:
        yield
    finally:
        with _growing.lock:
            _growing.picture = None


@contextmanager
def drawable(engine: bpy.types.RenderEngine):
    """Around Cycles' own function `render`, in whose session the picture is."""
    with _growing.lock:
        _growing.engine = engine
    try:
        yield
    finally:
        with _growing.lock:
            _growing.engine = None


def running(is_reference: bool = True) -> CyclesPicture | None:
    """The reference of which `draw` can draw something, or the traced light of our own picture."""
    with _growing.lock:
        picture = _growing.picture
        is_drawable = picture and picture.is_reference == is_reference and _growing.engine and picture.samples()
        return picture if is_drawable else None


def size() -> tuple[int, int] | None:
    """Width and height of the reference that `draw` draws, in pixels."""
    reference = running()
    return reference and (reference.width, reference.height)


def view() -> int:
    """The number of the view that Cycles renders; 0 without stereoscopy."""
    with _growing.lock:
        picture = _growing.picture
        name = _growing.engine.active_view_get() if picture and _growing.engine else ""
        return picture.views.index(name) if picture and name in picture.views else 0


def draw(context: bpy.types.Context) -> None:
    """Draw it into the framebuffer that is bound, where GPU matrices put the pixels of an image.

    Cycles looks at the pass that the Image Editor shows. If its function is not the one that we know, it is not called
    again during this run.
    """
    with _growing.lock:
        if _growing.engine is None:
            return
        try:
            import cycles.engine as cycles_engine
            depsgraph = context.view_layer.depsgraph or context.evaluated_depsgraph_get()
            cycles_engine.draw(_growing.engine, depsgraph, context.space_data)
        except (ImportError, AttributeError, TypeError, RuntimeError, SystemError) as error:
            print(f"RenderFormer-V2: a reference cannot be shown while it is rendered: {error}")
            _growing.engine = None
