# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the pictures to compare: passes of the render result, of other slots and of loaded images, of any engine.

Python cannot see the pixels of these passes, but Blender can save them: to a temporary file, which is read and removed.
"""
from __future__ import annotations

import tempfile
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ...model.pictures import srgb_to_linear
from .. import compat, exr
from .. import passes as pass_table
from . import header
from .export import file_format
from .pictures import Picture, lacks_reference, read_credits
from .slots import full, render_slots

CHANNEL_ORDER = "RXUGYVBZAW"  # U, V and A of the UV pass are a vector as well


class SourceError(Exception):
    """A picture is missing; the message says what to do."""


class OnePicture(SourceError):
    """Both sides name the same picture, which has no reference."""


class Reader:
    """Reads pictures for a scene. Each slot and image is saved once, however many of its passes are read."""

    def __init__(self, scene: bpy.types.Scene):
        self._scene = scene
        self.files: dict[tuple, exr.Multilayer] = {}  # by key(side)

    def picture(self, side) -> Picture:
        """The picture that `side` (settings.Side) names. Raises SourceError."""
        if side.kind == "IMAGE":
            image, name = find_image(side), side.image
            if len(image.pixels):  # loads the image; empty for a multilayer EXR
                return Picture((name,), _read_pixels(image), *[full(*image.size)] * 2)
        layer, pass_name = self.chosen(side)
        file = self.files[key(side)]
        pass_name = header.pass_in_view(file, find_image(side), layer, pass_name)
        return _read_pass(file, layer, pass_name, slot_number(side), _name(side))

    def chosen(self, side) -> tuple[str, str]:
        """(layer, pass) that `side` names; what it leaves open is as in the header. Raises SourceError."""
        image = find_image(side)
        if key(side) not in self.files:
            self.files[key(side)] = self._read_file(image, slot_number(side))
        file = self.files[key(side)]
        layer, pass_name = header.shown(file, image, self._scene)
        if side.pass_name:
            pass_name = side.pass_name
        elif side.layer:
            pass_name = next(iter(header.passes(file, side.layer, self._scene)), "Combined")
        with_pass = [name for name in header.layers(file, self._scene) if (name, pass_name) in file.passes]
        if side.layer or layer in with_pass:
            return side.layer or layer, pass_name
        return next((name for name in with_pass if name != header.COMPOSITE), layer), pass_name

    def names(self, side) -> list[tuple[str, str]]:
        """(layer, pass) of all that was read for a side."""
        return list(self.files[key(side)].passes) if key(side) in self.files else []

    def _read_file(self, image: bpy.types.Image, slot: int | None) -> exr.Multilayer:
        if slot and slot > len(image.render_slots):
            raise SourceError(f"There is no slot {slot}: the render result has {len(image.render_slots)}")
        with tempfile.TemporaryDirectory() as folder, _slot_shown(image, slot), \
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
        """Save into an empty folder. Raises RuntimeError.

        The views of stereoscopy take two attempts: in the first Blender writes a file for each and reports an error.
        """
        try:
            image.save_render(str(path), scene=self._scene)
        except RuntimeError:
            if not any(path.parent.iterdir()):
                raise
            image.save_render(str(path), scene=self._scene)


def find_image(side) -> bpy.types.Image:
    """Raises SourceError."""
    if side.kind != "IMAGE":
        return _render_result()
    if side.image not in bpy.data.images:
        raise SourceError("Choose an image that is loaded" if not side.image else f"There is no image '{side.image}'")
    return bpy.data.images[side.image]


def _name(side) -> str:
    """As in the header: users rename slots, and a slot keeps its name when one before it is removed."""
    return side.image if side.kind == "IMAGE" else _slot_name(_render_result(), slot_number(side))


def _slot_name(image: bpy.types.Image, number: int) -> str:
    return image.render_slots[number - 1].name


def slot_number(side) -> int | None:
    """The number of the slot, from 1; None for an image."""
    if side.kind == "SHOWN":
        return _render_result().render_slots.active_index + 1
    return side.slot if side.kind == "SLOT" else None


def key(side) -> tuple:
    """Identifies the file that is saved for a side."""
    return ("image", side.image) if side.kind == "IMAGE" else ("slot", slot_number(side))


def count_slots() -> int:
    return sum(len(image.render_slots) for image in bpy.data.images if image.type == "RENDER_RESULT")


def _render_result() -> bpy.types.Image:
    for image in bpy.data.images:
        if image.type == "RENDER_RESULT":
            return image
    raise SourceError("No render yet")


@contextmanager
def _slot_shown(image: bpy.types.Image, slot: int | None):
    if slot is None:
        yield
        return
    before = image.render_slots.active_index
    image.render_slots.active_index = slot - 1
    try:
        yield
    finally:
        image.render_slots.active_index = before


def _read_pixels(image: bpy.types.Image) -> np.ndarray:
    """(H, W, 4), as Picture.pixels, of an image without passes."""
    width, height = image.size
    pixels = np.empty((height, width, image.channels), np.float32)
    image.pixels.foreach_get(pixels.ravel())
    color, alpha = np.split(pixels[::-1], [min(image.channels, 3)], -1)
    color, alpha = np.broadcast_to(color[..., -3:], (height, width, 3)), alpha if alpha.size else np.float32(1)
    if not image.is_float:
        color = (srgb_to_linear(color) if image.colorspace_settings.name == "sRGB" else color) * alpha
    return np.concatenate([color, np.broadcast_to(alpha, (height, width, 1))], -1).astype(np.float32)


def _read_pass(file: exr.Multilayer, layer: str, name: str, slot: int | None, slot_name: str) -> Picture:
    if (layer, name) not in file.passes:
        existing = ", ".join(sorted({other for other_layer, other in file.passes if other_layer == layer}))
        raise SourceError(f"{slot_name} has no pass '{name}' in '{layer}'. "
                          f"Choose one of: {existing or 'none in this layer'}")
    pixels, (usual_name, view) = _rgba(file.passes[layer, name]), file.split_view(name)
    is_reference = usual_name in pass_table.REFERENCE_NAMES
    if is_reference and lacks_reference(file.metadata, layer) and not pixels[..., :3].any():
        raise SourceError(f"{slot_name} has no {name} in '{layer}': it was stopped before every pixel had a sample, or "
                          "failed")
    height, width, _ = pixels.shape
    path = slot_name, layer, usual_name, *([view or file.views[0]] if file.views else [])
    return Picture(path, pixels, render_slots.crop(slot, width, height), render_slots.rendered(slot, width, height),
                   read_credits(file.metadata, layer, usual_name))


def _rgba(channels: dict[str, np.ndarray]) -> np.ndarray:
    """(H, W, 4) as Blender shows a pass: a value is grey, a vector is red, green and blue."""
    ordered = [channels[c] for c in sorted(channels, key=lambda c: CHANNEL_ORDER.find(c))]
    alpha = ordered[3] if "R" in channels and len(ordered) > 3 else np.ones_like(ordered[0])
    color = ordered[:1] * 3 if len(ordered) == 1 else (ordered + [np.zeros_like(alpha)])[:3]
    return np.stack([*color, alpha], -1).astype(np.float32)
