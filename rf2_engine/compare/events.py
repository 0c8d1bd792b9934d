# SPDX-License-Identifier: GPL-3.0-or-later
"""Read, measure and draw the comparison again after renders and after changes of the settings or the slot."""
from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..registering import handlers
from . import comparison

INTERVAL = 0.2  # seconds between two looks at what goes on

blink = False   # B is shown


def read() -> None:
    """Read and begin to measure."""
    comparison.read()
    redraw()
    if comparison.a:
        comparison.measurement = comparison.new_measurement()
        comparison.measurement.start()
        _call(_watch, INTERVAL)


def read_soon() -> None:
    """As soon as Blender is idle, and only if the comparison is shown."""
    if comparison.settings().show and not comparison.is_reading:
        _call(_read, 0.0)


def look_again() -> None:
    """Whenever an Image Editor is drawn."""
    if comparison.is_outdated():
        read_soon()


def switch(show: bool) -> None:
    if show:
        read_soon()
        _call(_blink, 0.0)
    else:
        comparison.forget()
        redraw()


def redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR":
                area.tag_redraw()


def _read() -> float | None:
    if not comparison.settings().show:
        return None
    if bpy.app.is_job_running("RENDER"):
        return INTERVAL
    read()
    return None


def _watch() -> float | None:
    redraw()
    return INTERVAL if comparison.measurement and comparison.measurement.is_running else None


def _blink() -> float | None:
    global blink
    chosen = comparison.settings()
    if not chosen.show:
        return None
    if chosen.mode == "BLINK":
        blink = not blink
        redraw()
    return chosen.interval


def _call(action, seconds: float) -> None:
    if not bpy.app.timers.is_registered(action):
        bpy.app.timers.register(action, first_interval=seconds)


@persistent
def _rendered(*_):
    comparison.outdate()  # and nothing more: this may be the thread of the render. The editor is drawn again anyway


@persistent
def _loaded(*_):
    comparison.forget_all()
    comparison.settings().show = False


register, _remove_handlers = handlers(("render_complete", _rendered), ("render_cancel", _rendered),
                                      ("load_post", _loaded))


def unregister() -> None:
    _remove_handlers()
    for action in (_read, _watch, _blink):
        if bpy.app.timers.is_registered(action):
            bpy.app.timers.unregister(action)
    comparison.forget_all()
