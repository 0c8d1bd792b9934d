# SPDX-License-Identifier: GPL-3.0-or-later
"""Read, measure and draw the comparison again after renders and after changes of the settings or the slot."""
from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..cycles import growing
from ..progress import last_render
from ..registering import handlers
from ..setup import packages
from . import comparison, fitting

INTERVAL = 0.2  # seconds between two looks at what goes on

blink = False   # B is shown
_fitted = False  # the editors were zoomed out for two pictures
_offered = False  # this render has shown its reference: whoever switches it off means it


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
    fit_soon()
    if show:
        read_soon()
        _call(_blink, 0.0)
    else:
        comparison.forget()
        redraw()


def fit_soon() -> None:
    """As soon as Blender is idle, if two pictures come side by side, or one takes their place."""
    _call(_fit, 0.0)


def offer_both() -> None:
    """As soon as there is something of a reference; the user may switch it off again."""
    global _offered
    if not _offered and _wants_both():
        _call(_show_both, 0.0)
    _offered = True


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


def _fit() -> float | None:
    global _fitted
    chosen, size = comparison.settings(), _size()
    if comparison.is_reading or chosen.show and size is None and not comparison.message:
        return INTERVAL
    wanted = chosen.show and size is not None and chosen.mode == "SIDE"
    if wanted != _fitted:
        _fitted = wanted
        fitting.fit(size if wanted else None)
    return None


def _size() -> tuple[int, int] | None:
    """Width and height of each of the two pictures, in pixels, once there are two."""
    if comparison.a is not None:
        return comparison.a.pixels.shape[1::-1]
    return growing.size()


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


def _wants_both() -> bool:
    chosen = packages.preferences()  # none where a script enabled the add-on
    return chosen is None or chosen.show_reference


def _show_both() -> None:
    comparison.show_reference()
    redraw()


def show_reference() -> float | None:
    """Once the render has ended."""
    if bpy.app.is_job_running("RENDER"):
        return INTERVAL
    comparison.show_reference()
    read_soon()
    return None


@persistent
def _begins(*_):
    global _offered
    _offered = False


@persistent
def _rendered(*_):
    comparison.outdate()  # and nothing more: this may be the thread of the render. The editor is drawn again anyway
    if not _offered and _wants_both() and any(layer.reference_samples for layer in last_render.last_frame):
        _call(show_reference, 0.0)


@persistent
def _loaded(*_):
    comparison.forget_all()
    comparison.settings().show = False


register, _remove_handlers = handlers(("render_init", _begins), ("render_complete", _rendered),
                                      ("render_cancel", _rendered), ("load_post", _loaded))


def unregister() -> None:
    _remove_handlers()
    for action in (_read, _fit, _watch, _blink, _show_both, show_reference):
        if bpy.app.timers.is_registered(action):
            bpy.app.timers.unregister(action)
    comparison.forget_all()
