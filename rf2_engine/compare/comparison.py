# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison that is shown: two pictures, read when something about them changes, and how close they are."""
from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from . import sources
from .measuring import Box, Measurement

REFERENCE = "Cycles Reference"  # a pass of our own engine
INTERVAL = 0.2                  # seconds between two looks at what goes on

a: sources.Picture | None = None
b: sources.Picture | None = None
measurement: Measurement | None = None
message = ""       # why there is nothing to see
generation = 0     # counts what was read
blink = False      # B is shown

_known: dict[tuple, list[tuple[str, str]]] = {}  # (layer, pass) by sources.key
_read_keys: tuple = ()
_is_reading = False


def settings():
    return bpy.context.window_manager.renderformer_v2_compare


def is_shown() -> bool:
    """While Blender renders, the picture that grows is shown instead."""
    return settings().show and a is not None and not bpy.app.is_job_running("RENDER")


def known_passes(side) -> list[tuple[str, str]]:
    """(layer, pass) of what a settings.Side had when it was read last."""
    try:
        return _known.get(sources.key(side), [])
    except sources.SourceError:
        return []


def read(measure: bool = True) -> None:
    """Read both pictures; what is missing is said in `message`."""
    global a, b, message, generation, _read_keys, _is_reading
    chosen, scene = settings(), bpy.context.scene
    forget()
    reader, _is_reading = sources.Reader(scene), True
    try:
        _read_keys = keys()
        _tell_apart(chosen, reader)
        found = [reader.picture(side) for side in (chosen.a, chosen.b)]
        (height, width), (height_b, width_b) = (picture.pixels.shape[:2] for picture in found)
        if (height, width) != (height_b, width_b):
            raise sources.SourceError(f"A has {width} x {height} pixels, B {width_b} x {height_b}: "
                                      "choose pictures of one size")
        a, b = found
    except sources.SourceError as error:
        message = str(error)
        return
    finally:
        _known.update({key: list(file.passes) for key, file in reader.files.items()})
        generation += 1
        _is_reading = False
        redraw()
    if measure:
        measure_soon()


def _tell_apart(chosen, reader: sources.Reader) -> None:
    """B is the reference beside A when nothing else was chosen. Raises SourceError when there is none."""
    if _same(chosen.a, chosen.b):
        reader.picture(chosen.a)
        if REFERENCE not in (name for _, name in reader.names(chosen.b)):
            raise sources.SourceError("A and B are the same picture: choose another pass, slot or image for one")
        chosen.b.pass_name = REFERENCE


def _same(a, b) -> bool:
    return sources.key(a) == sources.key(b) and (a.layer, a.pass_name) == (b.layer, b.pass_name)


def keys() -> tuple:
    """What the sides are taken from; another slot that is shown changes it."""
    try:
        return sources.key(settings().a), sources.key(settings().b)
    except sources.SourceError:
        return ()


def look_again() -> None:
    """Read when another slot is shown than was read."""
    if keys() != _read_keys:
        read_soon()


def measure_soon() -> None:
    """On a thread; needs the two pictures."""
    global measurement
    stop_measuring()
    measurement = Measurement(a, b, Box(bpy.context.scene, settings().region, a.pixels.shape[:2]))
    measurement.start()
    _call(_watch, INTERVAL)


def stop_measuring() -> None:
    if measurement:
        measurement.cancel()


def read_soon() -> None:
    """As soon as Blender is idle, and only if the comparison is shown."""
    if settings().show and not _is_reading:
        _call(_read, 0.0)


def switch(show: bool) -> None:
    if show:
        read_soon()
        _call(_blink, 0.0)
    else:
        forget()
        redraw()


def forget() -> None:
    global a, b, message, measurement
    stop_measuring()
    a = b = measurement = None
    message = ""


def redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR":
                area.tag_redraw()


def _read() -> float | None:
    if not settings().show:
        return None
    if bpy.app.is_job_running("RENDER"):
        return INTERVAL
    read()
    return None


def _watch() -> float | None:
    redraw()
    return INTERVAL if measurement and measurement.is_running else None


def _blink() -> float | None:
    global blink
    chosen = settings()
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
    read_soon()


@persistent
def _loaded(*_):
    _known.clear()
    settings().show = False


_HANDLERS = (("render_complete", _rendered), ("render_cancel", _rendered), ("load_post", _loaded))


def register() -> None:
    for event, handler in _HANDLERS:
        getattr(bpy.app.handlers, event).append(handler)


def unregister() -> None:
    for event, handler in _HANDLERS:
        if handler in getattr(bpy.app.handlers, event):
            getattr(bpy.app.handlers, event).remove(handler)
    for action in (_read, _watch, _blink):
        if bpy.app.timers.is_registered(action):
            bpy.app.timers.unregister(action)
    forget()
    _known.clear()
