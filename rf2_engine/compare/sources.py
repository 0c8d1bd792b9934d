# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the pictures to compare: passes of the render result, of other slots and of loaded images, of any engine.

Blender gives Python no access to the pixels of these passes, but it can save them: to a temporary file, which is read
and removed.
"""
from __future__ import annotations

import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...model.color import srgb_to_linear
from .. import compat, exr
from .. import passes as pass_table
from . import credits, header, windows
from .credits import Credits
from .saving import file_format
from .windows import Window

CHANNEL_ORDER = "RXUGYVBZAW"  # U, V and A of the UV pass are a vector, too


class SourceError(Exception):
    """A picture is not there; the message says what to do."""


@dataclass(frozen=True)
class Picture:
    place: tuple[str, ...]  # slot or image; for a pass its view layer and its name; in stereoscopy its view
    pixels: np.ndarray  # (H, W, 4) f32, scene-linear, premultiplied, row 0 on top
    window: Window      # the part of the frame that it shows
    rendered: Window    # the part of it that was rendered, in its own pixels
    credits: Credits = Credits()

    @property
    def name(self) -> str:
        return ", ".join(self.place)

    @property
    def label(self) -> str:
        """"Cycles, 256 samples, 78 s (Slot 1, ViewLayer, Combined)"."""
        credits = str(self.credits)
        return f"{credits} ({self.name})" if credits else self.name


class Reader:
    """Reads pictures for `scene`; each slot and image is saved once, however many passes of it are wanted."""

    def __init__(self, scene: bpy.types.Scene):
        self._scene = scene
        self.files: dict[tuple, exr.Multilayer] = {}  # by key(side)

    def picture(self, side) -> Picture:
        """What `side` (settings.Side) asks for. Raises SourceError."""
        if side.kind == "IMAGE":
            image, name = image_of(side), side.image
            if len(image.pixels):  # which loads it; empty for a multilayer EXR
                return Picture((name,), _plain(image), *[windows.whole(*image.size)] * 2)
        layer, of = self.chosen(side)
        file = self.files[key(side)]
        return _pass_of(file, layer, header.of_view(file, image_of(side), layer, of), slot_number(side), _name(side))

    def chosen(self, side) -> tuple[str, str]:
        """(layer, pass) of what `side` asks for; what it leaves open is as in the header. Raises SourceError."""
        image = image_of(side)
        if key(side) not in self.files:
            self.files[key(side)] = self._saved(image, slot_number(side))
        file = self.files[key(side)]
        layer, of = header.shown(file, image, self._scene)
        if side.layer and not side.pass_name:
            of = header.passes(file, side.layer, self._scene)[:1]
            of = of[0] if of else "Combined"
        of = side.pass_name or of
        having = [name for name in header.layers(file, self._scene) if (name, of) in file.passes]
        if side.layer or layer in having:
            return side.layer or layer, of
        return next((name for name in having if name != header.COMPOSITE), layer), of

    def names(self, side) -> list[tuple[str, str]]:
        """(layer, pass) of what was read for a side."""
        return list(self.files[key(side)].passes) if key(side) in self.files else []

    def _saved(self, image: bpy.types.Image, slot: int | None) -> exr.Multilayer:
        if slot and slot > len(image.render_slots):
            raise SourceError(f"There is no slot {slot}: the render result has {len(image.render_slots)}")
        with tempfile.TemporaryDirectory() as folder, _shown(image, slot), \
                file_format(self._scene, "OPEN_EXR_MULTILAYER", color_depth="32", exr_codec="NONE",
                            views_format="MULTIVIEW", colorspace=compat.working_space()):
            path = Path(folder) / "passes.exr"
            try:
                self._save(image, path)
                return exr.read(path)
            except RuntimeError as error:
                raise SourceError(f"{_slot_name(image, slot)} is empty: render into it first" if slot else
                                  f"The passes of '{image.name}' cannot be read") from error
            except (OSError, ValueError) as error:
                raise SourceError(f"The passes of '{image.name}' cannot be read: {error}") from error

    def _save(self, image: bpy.types.Image, path: Path) -> None:
        """Into an empty folder. At first Blender saves the views of stereoscopy to a file each, and says that it could
        not; asked again, it saves them. Raises RuntimeError."""
        try:
            image.save_render(str(path), scene=self._scene)
        except RuntimeError:
            if not any(path.parent.iterdir()):
                raise
            image.save_render(str(path), scene=self._scene)


def image_of(side) -> bpy.types.Image:
    """Raises SourceError."""
    if side.kind != "IMAGE":
        return _render_result()
    if side.image not in bpy.data.images:
        raise SourceError("Choose an image that is loaded" if not side.image else f"There is no image '{side.image}'")
    return bpy.data.images[side.image]


def _name(side) -> str:
    """As the header has it: a slot keeps its name where one before it is removed, and users give others."""
    return side.image if side.kind == "IMAGE" else _slot_name(_render_result(), slot_number(side))


def _slot_name(image: bpy.types.Image, number: int) -> str:
    return image.render_slots[number - 1].name


def slot_number(side) -> int | None:
    """From 1; None for an image."""
    if side.kind == "SHOWN":
        return _render_result().render_slots.active_index + 1
    return side.slot if side.kind == "SLOT" else None


def key(side) -> tuple:
    """Tells what is saved for a side apart from what is saved for another."""
    return ("image", side.image) if side.kind == "IMAGE" else ("slot", slot_number(side))


def slots() -> int:
    """How many render slots there are."""
    return sum(len(image.render_slots) for image in bpy.data.images if image.type == "RENDER_RESULT")


def _render_result() -> bpy.types.Image:
    for image in bpy.data.images:
        if image.type == "RENDER_RESULT":
            return image
    raise SourceError("No render yet")


@contextmanager
def _shown(image: bpy.types.Image, slot: int | None):
    if slot is None:
        yield
        return
    before = image.render_slots.active_index
    image.render_slots.active_index = slot - 1
    try:
        yield
    finally:
        image.render_slots.active_index = before


def _plain(image: bpy.types.Image) -> np.ndarray:
    """Pixels of an image without passes."""
    width, height = image.size
    pixels = np.empty((height, width, image.channels), np.float32)
    image.pixels.foreach_get(pixels.ravel())
    color, alpha = np.split(pixels[::-1], [min(image.channels, 3)], -1)
    color, alpha = np.broadcast_to(color[..., -3:], (height, width, 3)), alpha if alpha.size else np.float32(1)
    if not image.is_float:
        color = (srgb_to_linear(color) if image.colorspace_settings.name == "sRGB" else color) * alpha
    return np.concatenate([color, np.broadcast_to(alpha, (height, width, 1))], -1).astype(np.float32)


def _pass_of(file: exr.Multilayer, layer: str, of: str, slot: int | None, name: str) -> Picture:
    if (layer, of) not in file.passes:
        there = ", ".join(sorted({each for each_layer, each in file.passes if each_layer == layer}))
        raise SourceError(f"{name} has no pass '{of}' in '{layer}'. Choose one of: {there or 'none in this layer'}")
    pixels, (usual, view) = _rgba(file.passes[layer, of]), file.apart(of)
    lacks = usual in pass_table.REFERENCE_NAMES and credits.lacks_reference(file.metadata, layer)
    if lacks and not pixels[..., :3].any():
        raise SourceError(f"{name} has no {of} in '{layer}': it was stopped before every pixel had a sample, or failed")
    height, width, _ = pixels.shape
    place = name, layer, usual, *([view or file.views[0]] if file.views else [])
    return Picture(place, pixels, windows.of_slot(slot, width, height),
                   windows.rendered_of_slot(slot, width, height), credits.of_pass(file.metadata, layer, usual))


def _rgba(channels: dict[str, np.ndarray]) -> np.ndarray:
    """As Blender shows them: values are grey, vectors are red, green and blue."""
    ordered = [channels[c] for c in sorted(channels, key=lambda c: CHANNEL_ORDER.find(c))]
    alpha = ordered[3] if "R" in channels and len(ordered) > 3 else np.ones_like(ordered[0])
    color = ordered[:1] * 3 if len(ordered) == 1 else (ordered + [np.zeros_like(alpha)])[:3]
    return np.stack([*color, alpha], -1).astype(np.float32)
