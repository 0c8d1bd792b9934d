# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep track of running renders, because Blender crashes when an engine's class is unregistered during one.

A render runs in the thread that asked for it in background mode, and in a thread of its own in the window. After
`RenderEngine.render` has returned Blender still uses the engine, so a render ends where its last handler is called.
It counts from its first frame on: an animation that fails before that one calls no handler after render_init.
"""
from __future__ import annotations

import threading
import time
from collections.abc import Callable

import bpy
from bpy.app.handlers import persistent

from ..registering import handlers

ENGINE = "RENDERFORMER_V2"  # bl_idname of our engine
PATIENCE = 5.0   # seconds; Cycles does not look at our wish to stop, and the window stands still meanwhile
TIDYING = 0.1    # seconds; what Blender itself does after its last handler

_frameless = False      # the render initialized last has begun no frame
_depth = 0              # renders within renders: a scene strip of the sequencer
_thread: int | None = None
_ours = False
_stopping = False
_ended = threading.Event()
_ended.set()
_afterwards: Callable[[], None] | None = None


def mark(engine: str) -> None:
    """The render under way uses our engine if that is the name of `engine`."""
    global _ours
    _ours = _ours or engine == ENGINE


def is_under_way() -> bool:
    """True while a render of ours runs, in whatever thread."""
    return _ours and not _ended.is_set()


def is_stopping() -> bool:
    """True when the render under way is to cancel itself, because the add-on is being disabled."""
    return _stopping


def stop() -> bool:
    """End a render of ours and wait for it. False if it goes on: it runs in this very thread, or does not listen."""
    global _stopping
    if _ended.is_set() or not _ours:
        return True
    _stopping = True
    if _thread == threading.get_ident() or not _ended.wait(PATIENCE):
        return False
    time.sleep(TIDYING)
    return True


def afterwards(action: Callable[[], None]) -> None:
    """Call `action` when the render under way has ended."""
    global _afterwards
    _afterwards = action
    if not bpy.app.background:
        bpy.app.timers.register(_look, first_interval=TIDYING, persistent=True)


def forget_afterwards() -> bool:
    """True if an action was waiting for the end of a render; it will not be called."""
    global _afterwards
    waiting, _afterwards = _afterwards is not None, None
    return waiting


@persistent
def _initialize(*_):
    global _frameless
    _frameless = True


@persistent
def _begin_frame(scene, *_):
    global _frameless, _depth, _thread
    if not _frameless:
        return
    _frameless = False
    if not _depth:
        _thread = threading.get_ident()
        _ended.clear()
    _depth += 1
    mark(scene.render.engine)


@persistent
def _end(*_):
    global _frameless, _depth, _thread, _ours, _stopping
    if not _frameless:
        _depth = max(_depth - 1, 0)
    _frameless = False
    if _depth:
        return
    _thread, _ours, _stopping = None, False, False
    _ended.set()
    if bpy.app.background:
        _look()


def _look() -> float | None:
    if not _ended.is_set():
        return TIDYING
    action = _afterwards
    if forget_afterwards():
        action()
    return None


register, unregister = handlers(("render_init", _initialize), ("render_pre", _begin_frame),
                                ("render_complete", _end), ("render_cancel", _end))
