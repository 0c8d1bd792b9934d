# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels of Blender images as scene-linear arrays, a pyramid of sizes, and bilinear lookup.

Reads `Image.pixels` only; the user's images are never changed, scaled, packed or saved.
"""
from __future__ import annotations

import numpy as np

from ....model.color import srgb_to_linear

MISSING = np.array([1.0, 0.0, 1.0, 1.0], np.float32)  # magenta, as Blender shows a missing image
RAW_SPACES = {"Non-Color", "Raw", "Linear Rec.709", "Linear", "scene_linear", "data"}
MAX_SIZE = 2048


class ImageCache:
    """Pyramids of the images of one conversion, each read and reduced once."""

    def __init__(self, report, max_size: int = MAX_SIZE):
        self.report, self.max_size = report, max_size
        self._pyramids: dict[tuple, Pyramid] = {}

    def pyramid(self, image, owner: str, premultiply: bool) -> Pyramid:
        """Pyramid of `image`; one magenta texel, reported under `owner`, when it has no pixels."""
        key = (image.as_pointer() if image else 0, premultiply)
        if key not in self._pyramids:
            self._pyramids[key] = Pyramid(self._load(image, owner, premultiply))
        return self._pyramids[key]

    def _load(self, image, owner, premultiply):
        if image is None:
            self.report.approximated(owner, "an image texture node holds no image: magenta is used")
            return MISSING.reshape(1, 1, 4)
        if image.source not in ("FILE", "GENERATED"):
            kind = image.source.lower()
            self.report.approximated(owner, f'image "{image.name}" is {kind}: only its first loaded picture is used')
        pixels = read_pixels(image)
        if pixels is None:
            self.report.approximated(
                owner, f'image "{image.name}" cannot be read from "{image.filepath}": magenta is used; relink the file')
            return MISSING.reshape(1, 1, 4)
        space = image.colorspace_settings.name
        if image.alpha_mode == "NONE":
            pixels[..., 3] = 1
        if not image.is_float and space not in RAW_SPACES:
            if space != "sRGB":
                self.report.approximated(owner, f'colour space "{space}" of image "{image.name}" is read as sRGB')
            if premultiply and image.alpha_mode in ("STRAIGHT", "PREMUL"):
                pixels[..., :3] *= pixels[..., 3:]  # before decoding, as Cycles does
            pixels[..., :3] = srgb_to_linear(pixels[..., :3])
        rows, columns = (min(size, self.max_size) for size in pixels.shape[:2])
        return area_resample(pixels, rows, columns)


class Pyramid:
    """An image at its full size and ever halved, (h, w, 4) f32 each, row 0 at the bottom (V = 0)."""

    def __init__(self, pixels: np.ndarray):
        self.levels = [pixels]

    def level(self, index: int) -> np.ndarray:
        """Halved `index` times, never smaller than one texel."""
        while len(self.levels) <= index and max(self.levels[-1].shape[:2]) > 1:
            last = self.levels[-1]
            self.levels.append(area_resample(last, (last.shape[0] + 1) // 2, (last.shape[1] + 1) // 2))
        return self.levels[min(index, len(self.levels) - 1)]


def read_pixels(image) -> np.ndarray | None:
    """(h, w, 4) f32 as stored, row 0 at the bottom; None when the image cannot be read."""
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


def area_resample(pixels: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Mean of the area that each new texel covers; (h, w, c) f32 -> (rows, columns, c) f32."""
    for axis, size in ((0, rows), (1, columns)):
        old = pixels.shape[axis]
        if old == size:
            continue
        moved = np.moveaxis(pixels, axis, 0)
        integral = np.concatenate([np.zeros_like(moved[:1], np.float64), np.cumsum(moved, axis=0, dtype=np.float64)])
        edge = np.linspace(0, old, size + 1)
        whole = np.minimum(edge.astype(int), old - 1)
        part = (edge - whole).reshape(-1, *[1] * (moved.ndim - 1))
        at_edge = integral[whole] + part * moved[whole]
        pixels = np.ascontiguousarray(np.moveaxis(np.diff(at_edge, axis=0) * (size / old), 0, axis), np.float32)
    return pixels


def sample(pixels: np.ndarray, uv: np.ndarray, extension: str = "REPEAT", closest: bool = False) -> np.ndarray:
    """Bilinear (or closest) lookup: (h, w, c) at (..., 2+) UV -> (..., c) f32. `extension` as on the image node.

    Texel centres lie at (i + 0.5) / size (docs/scene-input.md 4.3), V grows with the row.
    """
    rows, columns = pixels.shape[:2]
    x, y = uv[..., 0] * columns - 0.5, uv[..., 1] * rows - 0.5
    if closest:
        return _texel(pixels, np.floor(x + 0.5), np.floor(y + 0.5), extension)
    x0, y0 = np.floor(x), np.floor(y)
    fx, fy = np.float32(x - x0)[..., None], np.float32(y - y0)[..., None]
    low = _texel(pixels, x0, y0, extension) * (1 - fx) + _texel(pixels, x0 + 1, y0, extension) * fx
    high = _texel(pixels, x0, y0 + 1, extension) * (1 - fx) + _texel(pixels, x0 + 1, y0 + 1, extension) * fx
    return low * (1 - fy) + high * fy


def _texel(pixels, x, y, extension):
    column, row = (_wrap(i, n, extension) for i, n in ((x, pixels.shape[1]), (y, pixels.shape[0])))
    found = np.take(pixels.reshape(-1, pixels.shape[2]), row * pixels.shape[1] + column, axis=0)
    if extension == "CLIP":
        inside = (x >= 0) & (x < pixels.shape[1]) & (y >= 0) & (y < pixels.shape[0])
        found = found * inside[..., None]
    return found


def _wrap(index, size, extension):
    index = np.nan_to_num(index, posinf=0, neginf=0).astype(np.int32)
    if extension == "REPEAT":
        return index % size
    if extension == "MIRROR":
        index = index % (2 * size)
        return np.where(index < size, index, 2 * size - 1 - index)
    return np.clip(index, 0, size - 1)
