# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep track of running renders, because Blender crashes when an engine's class is unregistered during one.

A render runs in the thread that started it in background mode, and in a thread of its own in the window. After
`RenderEngine.render` has returned Blender still uses the engine, so a render ends where its last handler is called.
It counts from its first frame on: an animation that fails before that one calls no handler after render_init.
"""
from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import bpy
from bpy.app.handlers import persistent

from ..registering import handlers

ENGINE = "RENDERFORMER_V2"  # bl_idname of our engine
PATIENCE = 5.0   # seconds; Cycles does not check whether it is to stop, and the window is blocked meanwhile
TIDYING = 0.1    # seconds that Blender needs after its last handler


@dataclass
class RenderState:
    """The renders of this process."""

    is_frameless: bool = False  # the render initialized last has begun no frame
    depth: int = 0              # renders within renders: a scene strip of the sequencer
    thread: int | None = None
    is_ours: bool = False       # one of them uses our engine
    is_stopping: bool = False
    ended: threading.Event = field(default_factory=threading.Event)
    when_ended: Callable[[], None] | None = None

    def __post_init__(self) -> None:
        self.ended.set()

    def begin_frame(self, engine: str) -> None:
        if not self.is_frameless:
            return
        self.is_frameless = False
        if not self.depth:
            self.thread = threading.get_ident()
            self.ended.clear()
        self.depth += 1
        self.mark(engine)

    def mark(self, engine: str) -> None:
        self.is_ours = self.is_ours or engine == ENGINE

    def end(self) -> bool:
        """One of the renders has ended; whether it was the outermost one."""
        if not self.is_frameless:
            self.depth = max(self.depth - 1, 0)
        self.is_frameless = False
        if self.depth:
            return False
        self.thread, self.is_ours, self.is_stopping = None, False, False
        self.ended.set()
        return True

    def take_action(self) -> Callable[[], None] | None:
        """The action that waits for the end of a render, which waits no longer."""
        action, self.when_ended = self.when_ended, None
        return action


_state = RenderState()


def mark(engine: str) -> None:
    """Note that the render under way uses the engine of that name."""
    _state.mark(engine)


def is_under_way() -> bool:
    """True while a render of ours runs, in whatever thread."""
    return _state.is_ours and not _state.ended.is_set()


def is_stopping() -> bool:
    """True when the render under way is to cancel itself, because the add-on is being disabled."""
    return _state.is_stopping


def stop() -> bool:
    """End a render of ours and wait for it. False if it goes on: it runs in this very thread, or does not listen."""
    if not is_under_way():
        return True
    _state.is_stopping = True
    if _state.thread == threading.get_ident() or not _state.ended.wait(PATIENCE):
        return False
    time.sleep(TIDYING)
    return True


def when_ended(action: Callable[[], None]) -> None:
    """Call `action` when the render under way has ended."""
    _state.when_ended = action
    if not bpy.app.background:
        bpy.app.timers.register(_act_if_ended, first_interval=TIDYING, persistent=True)


def cancel_action() -> bool:
    """True if an action was waiting for the end of a render; it will not be called."""
    return _state.take_action() is not None


def _act_if_ended() -> float | None:
    if not _state.ended.is_set():
        return TIDYING
    if action := _state.take_action():
        action()
    return None


@persistent
def _initialize(*_):
    _state.is_frameless = True


@persistent
def _begin_frame(scene, *_):
    _state.begin_frame(scene.render.engine)


@persistent
def _end(*_):
    if _state.end() and bpy.app.background:
        _act_if_ended()


register, unregister = handlers(("render_init", _initialize), ("render_pre", _begin_frame),
                                ("render_complete", _end), ("render_cancel", _end))
