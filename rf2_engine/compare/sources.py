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
from . import windows
from .saving import file_format
from .windows import Window

CHANNEL_ORDER = "RXUGYVBZAW"  # U, V and A of the UV pass are a vector, too


class SourceError(Exception):
    """A picture is not there; the message says what to do."""


@dataclass(frozen=True)
class Picture:
    name: str
    pixels: np.ndarray  # (H, W, 4) f32, scene-linear, premultiplied, row 0 on top
    seconds: float | None  # that it took to render, if that is known
    window: Window         # the part of the frame that it shows


class Reader:
    """Reads pictures for `scene`; each slot and image is saved once, however many passes of it are wanted."""

    def __init__(self, scene: bpy.types.Scene):
        self._scene = scene
        self.files: dict[tuple, exr.Multilayer] = {}  # by key(side)

    def picture(self, side) -> Picture:
        """What `side` (settings.Side) asks for. Raises SourceError."""
        if side.kind == "IMAGE":
            image, name = bpy.data.images.get(side.image), side.image
            if image is None:
                raise SourceError("Choose an image that is loaded" if not name else f"There is no image '{name}'")
            if len(image.pixels):  # which loads it; empty for a multilayer EXR
                return Picture(name, _plain(image), None, windows.whole(*image.size))
        else:
            image, name = _render_result(), f"Slot {slot_number(side)}"
        if key(side) not in self.files:
            self.files[key(side)] = self._saved(image, slot_number(side))
        return _pass_of(self.files[key(side)], side, name, slot_number(side))

    def names(self, side) -> list[tuple[str, str]]:
        """(layer, pass) of what was read for a side."""
        return list(self.files[key(side)].passes) if key(side) in self.files else []

    def _saved(self, image: bpy.types.Image, slot: int | None) -> exr.Multilayer:
        if slot and slot > len(image.render_slots):
            raise SourceError(f"There is no slot {slot}: the render result has {len(image.render_slots)}")
        with tempfile.TemporaryDirectory() as folder, _shown(image, slot), \
                file_format(self._scene, "OPEN_EXR_MULTILAYER", color_depth="32", exr_codec="NONE",
                            colorspace=compat.working_space()):
            path = Path(folder) / "passes.exr"
            try:
                image.save_render(str(path), scene=self._scene)
                return exr.read(path)
            except RuntimeError as error:
                raise SourceError(f"Slot {slot} is empty: render into it first" if slot else
                                  f"The passes of '{image.name}' cannot be read") from error
            except (OSError, ValueError) as error:
                raise SourceError(f"The passes of '{image.name}' cannot be read: {error}") from error


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


def _pass_of(file: exr.Multilayer, side, name: str, slot: int | None) -> Picture:
    layers = sorted((layer for layer, of in file.passes if of == side.pass_name and side.layer in ("", layer)),
                    key=lambda layer: layer == "Composite")  # what the compositor made of it comes last
    if not layers:
        there = ", ".join(sorted({of for layer, of in file.passes if side.layer in ("", layer)}))
        raise SourceError(f"{name} has no pass '{side.pass_name}'" + (f" in '{side.layer}'" if side.layer else "") +
                          f". Choose one of: {there or 'none in this layer'}")
    pixels = _rgba(file.passes[layers[0], side.pass_name])
    height, width, _ = pixels.shape
    return Picture(f"{name}, {side.pass_name}", pixels, seconds(file.metadata, layers[0], side.pass_name),
                   windows.of_slot(slot, width, height))


def _rgba(channels: dict[str, np.ndarray]) -> np.ndarray:
    """As Blender shows them: values are grey, vectors are red, green and blue."""
    ordered = [channels[c] for c in sorted(channels, key=lambda c: CHANNEL_ORDER.find(c))]
    alpha = ordered[3] if "R" in channels and len(ordered) > 3 else np.ones_like(ordered[0])
    color = ordered[:1] * 3 if len(ordered) == 1 else (ordered + [np.zeros_like(alpha)])[:3]
    return np.stack([*color, alpha], -1).astype(np.float32)


def seconds(metadata: dict[str, str], layer: str, name: str) -> float | None:
    """How long a pass took, from what Blender and Cycles note in the file; None if they did not.

    `LAYER.PASS.seconds` counts first; a pass of Cycles beside another engine's has Cycles' own time; else it is the
    whole render's.
    """
    keys = [f"{layer}.{name}.seconds", "RenderTime"]
    if name.startswith("Cycles "):
        keys = [keys[0], f"cycles.{layer}.total_time"]
    for text in (metadata[k] for k in keys if k in metadata):
        try:
            return sum(float(part) * 60 ** i for i, part in enumerate(reversed(text.split(":"))))
        except ValueError:
            continue
    return None
