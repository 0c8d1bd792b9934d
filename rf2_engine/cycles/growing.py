# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of a running Cycles, as far as it is: drawn by Cycles itself, as in its own renders.

Cycles keeps it on the graphics card for that, in the window only, whether anybody looks or not, so drawing it costs
next to nothing.
"""
from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import contextmanager
from typing import NamedTuple

import bpy


class Running(NamedTuple):
    """A reference that Cycles renders beside our picture of a view layer."""

    layer: str
    width: int                  # of the picture, in pixels
    height: int
    our_seconds: float
    samples: Callable[[], int]  # so far
    wanted: int                 # samples
    begin: float                # by time.perf_counter
    left: int = 0               # of the render region in the frame, in pixels: Cycles draws it there
    bottom: int = 0
    views: tuple[str, ...] = ("",)  # of stereoscopy, which Cycles renders one after the other


_lock = threading.Lock()  # the window is drawn by another thread: engine and session must not go away meanwhile
_running: Running | None = None
_engine: bpy.types.RenderEngine | None = None


@contextmanager
def announced(running: Running):
    """Inside, what Cycles renders is this reference."""
    global _running
    _running = running
    try:
        yield
    finally:
        with _lock:
            _running = None


@contextmanager
def drawable(engine: bpy.types.RenderEngine):
    """Around Cycles' own function `render`, in whose session the picture is."""
    global _engine
    with _lock:
        _engine = engine
    try:
        yield
    finally:
        with _lock:
            _engine = None


def running() -> Running | None:
    """The reference of which `draw` can draw something."""
    with _lock:
        return _running if _running and _engine and _running.samples() else None


def size() -> tuple[int, int] | None:
    """Width and height of the picture that `draw` draws, in pixels."""
    reference = running()
    return reference and (reference.width, reference.height)


def view() -> int:
    """The number of the view that Cycles renders; 0 without stereoscopy."""
    with _lock:
        if _running is None or _engine is None or len(_running.views) < 2:
            return 0
        return _running.views.index(_engine.active_view_get())


def draw(context: bpy.types.Context) -> None:
    """Draw it into the framebuffer that is bound, where GPU matrices put the pixels of an image.

    Cycles looks at the pass that the Image Editor shows. One whose function is another than we know is not asked again.
    """
    global _engine
    with _lock:
        if _engine is None:
            return
        try:
            import cycles.engine as cycles_engine
            depsgraph = context.view_layer.depsgraph or context.evaluated_depsgraph_get()
            cycles_engine.draw(_engine, depsgraph, context.space_data)
        except (ImportError, AttributeError, TypeError, RuntimeError, SystemError) as error:
            print(f"RenderFormer-V2: a reference cannot be shown while it is rendered: {error}")
            _engine = None
