# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as Cycles looks them up: which picture, how alpha and colour space count, and what is missing."""
from __future__ import annotations

import numpy as np

from ....model import progress
from ....model.pictures import srgb_to_linear
from ... import compat
from ..data.images import MISSING, Picture, Pyramid, area_resample
from .image_files import frame_number, read_pixels, scene_linear

DATA_SPACES = {"Non-Color", "Raw", "data"}
LINEAR_SPACES = {"Linear", "scene_linear"}
MAX_SIZE = 2048
GREY = np.array([0.4, 0.4, 0.4, 1.0], np.float32)
BAND = 1 << 15  # texels that are decoded at a time, as many as fit into the processor's cache
BYTES = np.arange(256, dtype=np.float32) * np.float32(1 / 255)  # as Blender makes floats of them
LINEAR = srgb_to_linear(BYTES)


class Images:
    """The images of one conversion, each read and reduced once."""

    def __init__(self, frame: int, cache: dict | None = None):
        """frame: of the scene that is rendered, which image sequences show; cache: images that were read
        before, by session_uid and how they are read."""
        self.frame = frame
        self._cache: dict[tuple, tuple[Pyramid, str]] = {} if cache is None else cache

    def picture(self, node) -> Picture:
        """What an Image Texture or Environment Texture shows."""
        image = node.image
        if image is None:
            return Picture("", {None: _magenta()}, {None: "an Image Texture node has no image, so it is magenta"})
        frame = frame_number(node.image_user, self.frame) if image.source == "SEQUENCE" else None
        is_flat = node.bl_idname == "ShaderNodeTexImage"
        straight = is_flat and node.outputs["Alpha"].is_linked  # only where alpha is used
        tiles = [tile.number for tile in image.tiles] if is_flat and image.source == "TILED" else [None]
        tiles_read = {tile: self._read(image, straight, frame, tile) for tile in tiles}
        return Picture(image.source, {tile: pyramid for tile, (pyramid, _) in tiles_read.items()},
                       {tile: remark for tile, (_, remark) in tiles_read.items() if remark})

    def _read(self, image, straight: bool, frame: int | None, tile: int | None) -> tuple[Pyramid, str]:
        """The pixels of an image, and a remark if it cannot be read."""
        key = image.session_uid, straight, frame, tile
        if key not in self._cache:
            progress.report()
            pixels, remark = read_pixels(image, frame, tile), ""
            if pixels is None:
                which = f", frame {frame}" if frame is not None else f", tile {tile}" if tile is not None else ""
                remark = (f'image "{image.name}"{which} cannot be read from "{image.filepath}", so it is magenta: '
                          "relink the file")
            self._cache[key] = _magenta() if pixels is None else _reduced(_as_cycles(image, pixels, straight)), remark
        return self._cache[key]


class UnreadImages:
    """Replaces `Images` where reading them takes too long: all are grey."""

    def picture(self, node) -> Picture:
        """What an Image Texture or Environment Texture shows."""
        tiles = [tile.number for tile in node.image.tiles] if node.image and node.image.source == "TILED" else [None]
        return Picture(node.image.source if node.image else "", dict.fromkeys(tiles, Pyramid(GREY.reshape(1, 1, 4))))


def _magenta() -> Pyramid:
    return Pyramid(MISSING.reshape(1, 1, 4))


def _reduced(pyramid: Pyramid) -> Pyramid:
    rows, columns = (min(size, MAX_SIZE) for size in pyramid.shape)
    return pyramid if (rows, columns) == pyramid.shape else Pyramid(area_resample(pyramid.level(0), rows, columns))


def _as_cycles(image, pixels: np.ndarray, straight: bool) -> Pyramid:
    """Bytes of sRGB are interpolated in its curve, and multiplied with alpha in it; data never are.

    Texels that are infinite are clear, as in Cycles.
    """
    if image.is_float and not np.isfinite(pixels).all():
        pixels[np.isinf(pixels).any(axis=-1)] = 0
        np.nan_to_num(pixels, copy=False)
    space, mode = image.colorspace_settings.name, image.alpha_mode
    if mode == "NONE":
        pixels[..., 3] = 1
    associated = mode in ("STRAIGHT", "PREMUL") and space not in DATA_SPACES
    divided = _over_alpha if associated and straight else lambda texels: texels
    if image.is_float or space in DATA_SPACES:
        return Pyramid(pixels, divided)
    is_rec709 = compat.working_space() == "Linear Rec.709"
    curved = space == "sRGB" and is_rec709
    if not curved and not (space in LINEAR_SPACES or space == "Linear Rec.709" and is_rec709):
        pixels[..., :3] = scene_linear(pixels[..., :3], space)
    associated = associated and bool((pixels[..., 3] != 1).any())
    if associated:
        pixels[..., :3] *= pixels[..., 3:]
    if (mode == "PREMUL" and associated and image.source != "GENERATED" and not image.packed_file
            and compat.multiplies_premultiplied_files()):
        pixels[..., :3] *= pixels[..., 3:]  # Blender has divided by alpha
    return Pyramid(pixels, (lambda texels: _decoded(divided(texels))) if curved else divided)


def _over_alpha(texels: np.ndarray) -> np.ndarray:
    alpha = texels[..., 3:]
    return np.concatenate([texels[..., :3] / np.where(alpha == 0, 1, alpha), alpha], axis=-1)


def _decoded(texels: np.ndarray) -> np.ndarray:
    """Bytes, which most images are made of, are looked up: a power for each texel takes five times as long."""
    flat, decoded = texels.reshape(-1, 4), np.empty((texels.size // 4, 4), np.float32)
    for first in range(0, len(flat), BAND):
        some, own = flat[first:first + BAND], decoded[first:first + BAND]
        codes = (some * 255 + 0.5).clip(0, 255).astype(np.uint8)
        if (BYTES[codes] == some).all():
            np.take(LINEAR, codes, out=own)
        else:
            own[:, :3] = srgb_to_linear(some[:, :3])
        own[:, 3] = some[:, 3]
    return decoded.reshape(texels.shape)
