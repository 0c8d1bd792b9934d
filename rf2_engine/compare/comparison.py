# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison that is shown: two pictures and their metrics. `events.py` decides when they are read."""
from __future__ import annotations

import bpy

from . import header, sources
from .labels import of_pictures
from .measuring import Box, Measurement

REFERENCE = "Cycles Reference"  # a pass of our own engine

a: sources.Picture | None = None
b: sources.Picture | None = None
measurement: Measurement | None = None
message = ""        # why there is nothing to see
generation = 0      # counts what was read
is_reading = False

_known: dict[tuple, list[tuple[str, str]]] = {}  # (layer, pass) by sources.key
_read_keys: tuple | None = None


def settings():
    return bpy.context.window_manager.renderformer_v2_compare


def is_shown() -> bool:
    """While Blender renders, the picture that grows is shown instead."""
    return settings().show and a is not None and not bpy.app.is_job_running("RENDER")


def is_compared(image: bpy.types.Image | None) -> bool:
    """Whether A or B may be taken from it."""
    return image is not None and any(
        image.name == side.image if side.kind == "IMAGE" else image.type == "RENDER_RESULT"
        for side in (settings().a, settings().b))


def show_reference() -> None:
    """Compare the picture that was rendered with the reference beside it, whichever side the user has put it on.

    What is compared already goes on being compared.
    """
    chosen = settings()
    sides = {(side.kind, side.pass_name) for side in (chosen.a, chosen.b)}
    if not chosen.show and sides != {("SHOWN", ""), ("SHOWN", REFERENCE)}:
        for side, name in ((chosen.a, ""), (chosen.b, REFERENCE)):
            side.kind, side.layer, side.pass_name = "SHOWN", "", name
    chosen.show = True


def labels() -> list[tuple[str, str]]:
    """Of A and B, the longest first."""
    layers = {layer for side in (settings().a, settings().b) for layer, _ in known_passes(side)}
    return of_pictures(a, b, layered=len(layers - {header.COMPOSITE}) > 1)


def known_passes(side) -> list[tuple[str, str]]:
    """(layer, pass) of what a settings.Side had when it was read last."""
    try:
        return _known.get(sources.key(side), [])
    except sources.SourceError:
        return []


def read() -> None:
    """Read both pictures; what is missing is said in `message`."""
    global a, b, message, generation, is_reading, _read_keys
    manager, reader = bpy.context.window_manager, sources.Reader(bpy.context.scene)
    forget()
    is_reading = True
    manager.progress_begin(0, 2)
    try:
        _read_keys = _keys()
        a, b = _pictures(reader, manager)
    except sources.SourceError as error:
        message = str(error)
    finally:
        _known.update({key: list(file.passes) for key, file in reader.files.items()})
        generation += 1
        is_reading = False
        manager.progress_end()


def _pictures(reader: sources.Reader, manager) -> tuple[sources.Picture, sources.Picture]:
    """A and B. Raises SourceError."""
    chosen, found = settings(), []
    _tell_apart(chosen, reader)
    for side in (chosen.a, chosen.b):
        found.append(reader.picture(side))
        manager.progress_update(len(found))
    (height, width), (height_b, width_b) = (picture.pixels.shape[:2] for picture in found)
    if (height, width) != (height_b, width_b):
        raise sources.SourceError(f"A has {width} x {height} pixels, B {width_b} x {height_b}: "
                                  "choose pictures of one size")
    return tuple(found)


def _tell_apart(chosen, reader: sources.Reader) -> None:
    """B is the reference beside A when nothing else was chosen. Raises SourceError when there is none."""
    def what(side):
        return sources.key(side), (side.layer, side.pass_name) if side.kind == "IMAGE" else reader.chosen(side)

    if what(chosen.a) == what(chosen.b):
        reader.picture(chosen.a)
        is_reference = REFERENCE in (chosen.a.pass_name, what(chosen.a)[1][1])
        if is_reference or REFERENCE not in (name for _, name in reader.names(chosen.b)):
            raise sources.SourceError("A and B are the same picture: choose another pass, slot or image for one")
        chosen.b.pass_name = REFERENCE


def outdate() -> None:
    """What was read has changed."""
    global _read_keys
    _read_keys = None


def is_outdated() -> bool:
    """Whether that happened, or another slot is shown than was read."""
    return _keys() != _read_keys


def _keys() -> tuple:
    """What is compared, and where; a slot that is removed gives its number to the next."""
    chosen, render = settings(), bpy.context.scene.render
    region = (render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y)
    try:
        sides = [(sources.key(side), header.numbers(sources.image_of(side))) for side in (chosen.a, chosen.b)]
        return *sides, sources.slots(), chosen.region == "BORDER" and region
    except sources.SourceError:
        return ()


def new_measurement() -> Measurement:
    """A measurement of the two pictures, which must exist; not started."""
    return Measurement(a, b, Box(bpy.context.scene, settings().region, a, b))


def forget() -> None:
    global a, b, message, measurement
    if measurement:
        measurement.cancel()
    a = b = measurement = None
    message = ""


def forget_all() -> None:
    """The names of passes, too."""
    forget()
    _known.clear()
