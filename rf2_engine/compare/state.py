# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison: two pictures, their metrics, and all that is remembered between two calls by Blender.

`events.py` decides when the pictures are read; `draw.py` owns what lies on the graphics card.
"""
from __future__ import annotations

import bpy

from ..progress.last_render import REFERENCE
from ..runtime.running import ENGINE
from . import header, sources
from .measuring import Box, Measurement
from .pictures import Picture, label_pair


class Comparison:
    """Pictures A and B (None until both were read), and what is known about them. There is one: `comparison`."""

    def __init__(self):
        self.a: Picture | None = None
        self.b: Picture | None = None
        self.measurement: Measurement | None = None
        self.message = ""               # why nothing can be compared
        self.generation = 0             # counts the readings
        self.is_reading = False
        self.blinks_to_b = False        # Blink shows B at the moment
        self.is_zoomed_for_two = False  # the editors were zoomed out for pictures side by side
        self.is_offered = False         # this render has shown its reference once; who switches it off means it
        self.is_automatic = False       # a reference has switched it on, and nobody has chosen anything since
        self.has_one_picture = False    # A and B are the same, and there is no reference
        self._source: tuple | None = None  # what was read, see _current_source
        self._passes: dict[tuple, list[tuple[str, str]]] = {}  # (layer, pass) by sources.key

    @property
    def settings(self):
        """The CompareSettings of the window manager."""
        return bpy.context.window_manager.renderformer_v2_compare

    def is_shown(self) -> bool:
        """During a render its growing picture is shown instead."""
        return self.settings.show and self.a is not None and not bpy.app.is_job_running("RENDER")

    def uses(self, image: bpy.types.Image | None) -> bool:
        """Whether A or B may be taken from this image."""
        return image is not None and any(
            image.name == side.image if side.kind == "IMAGE" else image.type == "RENDER_RESULT"
            for side in (self.settings.a, self.settings.b))

    def show_reference(self) -> None:
        """Show the rendered picture and its reference; sides that the user has swapped stay swapped.

        A comparison that is already shown is left alone.
        """
        settings = self.settings
        sides = {(side.kind, side.pass_name) for side in (settings.a, settings.b)}
        if not settings.show and sides != {("SHOWN", ""), ("SHOWN", REFERENCE)}:
            for side, name in ((settings.a, ""), (settings.b, REFERENCE)):
                side.kind, side.layer, side.pass_name = "SHOWN", "", name
        if not settings.show:
            settings.show = True
            self.is_automatic = True

    def labels(self) -> list[tuple[str, str]]:
        """Labels of A and B, the longest pair first."""
        layers = {layer for side in (self.settings.a, self.settings.b) for layer, _ in self.known_passes(side)}
        return label_pair(self.a, self.b, has_layers=len(layers - {header.COMPOSITE}) > 1)

    def known_passes(self, side) -> list[tuple[str, str]]:
        """(layer, pass) that a settings.Side had when it was last read."""
        try:
            return self._passes.get(sources.key(side), [])
        except sources.SourceError:
            return []

    def read(self) -> None:
        """Read both pictures; `message` says what is missing."""
        manager, reader = bpy.context.window_manager, sources.Reader(bpy.context.scene)
        self.forget()
        self.is_reading = True
        manager.progress_begin(0, 2)
        try:
            self._source = self._current_source()
            self.a, self.b = self._read_pictures(reader, manager)
        except sources.SourceError as error:
            self.message, self.has_one_picture = str(error), isinstance(error, sources.OnePicture)
        finally:
            self._passes.update({key: list(file.passes) for key, file in reader.files.items()})
            self.generation += 1
            self.is_reading = False
            manager.progress_end()

    def _read_pictures(self, reader: sources.Reader, manager) -> tuple[Picture, Picture]:
        """A and B. Raises SourceError."""
        settings, pictures = self.settings, []
        self._choose_reference(reader)
        for side in (settings.a, settings.b):
            pictures.append(reader.picture(side))
            manager.progress_update(len(pictures))
        (height, width), (height_b, width_b) = (picture.pixels.shape[:2] for picture in pictures)
        if (height, width) != (height_b, width_b):
            raise sources.SourceError(f"A has {width} x {height} pixels, B {width_b} x {height_b}: "
                                      "choose pictures of one size")
        return tuple(pictures)

    def _choose_reference(self, reader: sources.Reader) -> None:
        """Make B the reference of A where both sides are the same picture. Raises SourceError if there is none.

        Beside a reference, which went through no compositor, an A that leaves its layer open is no Composite either.
        """
        def identity(side):
            return sources.key(side), (side.layer, side.pass_name) if side.kind == "IMAGE" else reader.chosen(side)

        a, b = self.settings.a, self.settings.b
        if identity(a) == identity(b):
            reader.picture(a)
            is_reference = REFERENCE in (a.pass_name, identity(a)[1][1])
            if is_reference or REFERENCE not in (name for _, name in reader.names(b)):
                way_out = "" if is_reference else _way_to_reference(b)
                raise sources.OnePicture(f"A and B are the same picture: {way_out}choose another pass, slot or image "
                                         "for one")
            b.pass_name = REFERENCE
        if b.kind != "IMAGE" and b.pass_name == REFERENCE and not a.layer and identity(a)[1][0] == header.COMPOSITE:
            a.layer, _ = reader.chosen(b)

    def outdate(self) -> None:
        """Note that the pictures have changed since they were read."""
        self._source = None

    def is_outdated(self) -> bool:
        """Whether the pictures have changed, or another slot is shown than was read."""
        return self._current_source() != self._source

    def _current_source(self) -> tuple:
        """All that decides which pixels are compared; a removed slot leaves its number to the next."""
        settings, render = self.settings, bpy.context.scene.render
        region = (render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y)
        try:
            sides = [(sources.key(side), header.numbers(sources.find_image(side)))
                     for side in (settings.a, settings.b)]
            return *sides, sources.count_slots(), settings.region == "BORDER" and region
        except sources.SourceError:
            return ()

    def new_measurement(self) -> Measurement:
        """A measurement, not yet started, of the two pictures, which must exist."""
        return Measurement(self.a, self.b, Box(bpy.context.scene, self.settings.region, self.a, self.b))

    def forget(self) -> None:
        """Forget pictures and metrics."""
        if self.measurement:
            self.measurement.cancel()
        self.a = self.b = self.measurement = None
        self.message, self.has_one_picture = "", False

    def forget_all(self) -> None:
        """Forget the names of passes as well, as another file needs it."""
        self.forget()
        self._passes.clear()

    def reset(self) -> None:
        """Everything as at first, when the add-on is disabled."""
        self.forget()
        self.__init__()


def _way_to_reference(side) -> str:
    """How to get a reference for a side; "" where a render brings it none."""
    if side.kind != "SHOWN" or bpy.context.scene.render.engine != ENGINE:
        return ""
    return "use Render Cycles Reference for a second one of Cycles, or "


comparison = Comparison()
