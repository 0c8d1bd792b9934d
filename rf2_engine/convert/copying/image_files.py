# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the pixels of Blender images: single images, UDIM tiles, frames of a sequence.

The user's images are never changed, scaled, packed or saved; other images that Blender has to load are removed again.
"""
from __future__ import annotations

import re
import tempfile
from pathlib import Path

import bpy
import numpy as np

from ... import main_thread
from ..data.images import FIRST_TILE, TILES_IN_A_ROW


def read_pixels(image, frame: int | None = None, tile: int | None = None) -> np.ndarray | None:
    """(h, w, 4) f32 as stored (floats: scene-linear), row 0 at the bottom; None when they cannot be read."""
    if frame is not None:
        return _of_file(image, of_frame(bpy.path.abspath(image.filepath, library=image.library), frame))
    if tile is None:
        return _pixels(image)
    if not image.packed_file:
        return _of_file(image, of_tile(bpy.path.abspath(image.filepath, library=image.library), tile))
    packed = next((file for file in image.packed_files if file.tile_number == tile), None)
    if packed is None:
        return None
    with tempfile.TemporaryDirectory(prefix="renderformer-v2-") as folder:
        path = Path(folder) / f"tile{Path(packed.filepath).suffix}"
        path.write_bytes(packed.packed_file.data)
        return _of_file(image, str(path))


def of_tile(path: str, tile: int) -> str:
    row, column = divmod(tile - FIRST_TILE, TILES_IN_A_ROW)
    return path.replace("<UDIM>", str(tile)).replace("<UVTILE>", f"u{column + 1}_v{row + 1}")


def of_frame(path: str, frame: int) -> str:
    """The path with the last number of its name replaced."""
    parent, name = Path(path).parent, Path(path).name
    numbers = list(re.finditer(r"\d+", Path(name).stem))
    if not numbers:
        return path
    start, end = numbers[-1].span()
    return str(parent / f"{name[:start]}{frame:0{end - start}}{name[end:]}")


def frame_number(user, now: int) -> int:
    """The number of the picture that an ImageUser shows in a frame of the scene."""
    frame, count = now - user.frame_start + 1, user.frame_duration
    if count == 0:
        return 0
    if user.use_cyclic:
        frame = frame % count or count
    return min(max(frame, 0), count) + user.frame_offset


def scene_linear(colors: np.ndarray, space: str) -> np.ndarray:
    """(..., 3) colours of a colour space as the file's scene-linear ones, by Blender's own colour management."""
    flat = np.ones((colors.size // 3, 4), np.float32)
    flat[:, :3] = colors.reshape(-1, 3)
    linear = np.empty(flat.size, np.float32)

    def convert():
        image = bpy.data.images.new("Colours", len(flat), 1, alpha=True, float_buffer=True)
        try:
            image.colorspace_settings.name = "Non-Color"
            image.pixels.foreach_set(flat.ravel())
            image.file_format = "OPEN_EXR"
            image.pack()
            image.colorspace_settings.name = space  # reads what is packed once more
            image.pixels.foreach_get(linear)
        finally:
            bpy.data.images.remove(image)

    main_thread.call(convert)
    return linear.reshape(-1, 4)[:, :3].reshape(colors.shape)


def _of_file(like, path: str) -> np.ndarray | None:
    """Pixels of another file, read as the image is."""
    pixels = []

    def load():
        image = bpy.data.images.load(path)
        try:
            image.colorspace_settings.name, image.alpha_mode = like.colorspace_settings.name, like.alpha_mode
            pixels.append(_pixels(image))
        finally:
            bpy.data.images.remove(image)

    try:
        main_thread.call(load)
    except RuntimeError:  # there is no such file, or it is none of a picture
        return None
    return pixels[0]


def _pixels(image) -> np.ndarray | None:
    count = len(image.pixels)  # loads the file
    columns, rows = image.size
    if count == 0 or columns * rows == 0:
        return None
    flat = np.empty(count, np.float32)
    image.pixels.foreach_get(flat)
    stored = flat.reshape(rows, columns, -1)
    if stored.shape[2] == 4:
        return stored
    color = np.repeat(stored[..., :1], 3, axis=2) if stored.shape[2] < 3 else stored[..., :3]
    alpha = stored[..., 1:2] if stored.shape[2] == 2 else np.ones_like(stored[..., :1])
    return np.concatenate([color, alpha], axis=2)
