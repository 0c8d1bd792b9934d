# SPDX-License-Identifier: GPL-3.0-or-later
"""What a texture node shows of its image, once it is read (copying/images.py)."""
from __future__ import annotations

from dataclasses import dataclass, field
from threading import Lock

import numpy as np

MISSING = np.array([1.0, 0.0, 1.0, 1.0], np.float32)  # magenta, as Blender shows a missing image
FIRST_TILE, TILES_IN_A_ROW = 1001, 10
BAND = 64  # rows that are halved at a time, an even number
_halving = Lock()  # several threads may read one image


@dataclass(frozen=True)
class Picture:
    """The pixels of an image at the frame that is rendered."""

    source: str                                                       # as of a `bpy.types.Image`; "" without one
    pyramids: dict[int | None, Pyramid] = field(default_factory=dict)  # of each UDIM tile; None: of the whole image
    missing: dict[int | None, str] = field(default_factory=dict)       # remarks on those that cannot be read


class Pyramid:
    """An image at its full size and ever halved, (h, w, 4) f32 each, row 0 at the bottom (V = 0).

    stored: texels as they are interpolated. finished: function from those to scene-linear colours.
    """

    def __init__(self, stored: np.ndarray, finished=lambda texels: texels):
        self.stored, self.finished, self._levels = stored, finished, []

    @property
    def shape(self) -> tuple[int, int]:
        return self.stored.shape[:2]

    def level(self, index: int) -> np.ndarray:
        """Scene-linear, halved `index` times, never smaller than one texel."""
        levels = self._levels
        with _halving:
            if not levels:
                levels.append(self.finished(self.stored))
            while len(levels) <= index and max(levels[-1].shape[:2]) > 1:
                levels.append(_halved(levels[-1]))
        return levels[min(index, len(levels) - 1)]

    def at(self, uv: np.ndarray, index: int, extension: str, interpolation: str) -> np.ndarray:
        """(..., 4) at (..., 2+) UV in a level. Small levels are means already, so these are interpolated linearly."""
        if index == 0:
            return self.finished(sample(self.stored, uv, extension, interpolation))
        return sample(self.level(index), uv, extension)


def _halved(pixels: np.ndarray) -> np.ndarray:
    """As area_resample to half as many rows and columns, rounded up; faster where both are even."""
    rows, columns = pixels.shape[:2]
    if rows % 2 or columns % 2:
        return area_resample(pixels, (rows + 1) // 2, (columns + 1) // 2)
    half = np.empty((rows // 2, columns // 2, pixels.shape[2]), np.float32)
    for first in range(0, rows, BAND):  # what fits into the processor's cache
        pairs = pixels[first:first + BAND:2] + pixels[first + 1:first + BAND:2]
        pairs *= 0.5
        own = half[first // 2:first // 2 + len(pairs)]
        np.add(pairs[:, ::2], pairs[:, 1::2], out=own)
        own *= 0.5
    return half


def area_resample(pixels: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Mean of the area that each new texel covers; (h, w, c) f32 -> (rows, columns, c) f32."""
    for axis, size in ((0, rows), (1, columns)):
        old = pixels.shape[axis]
        if old == size:
            continue
        moved = np.moveaxis(pixels, axis, 0)
        integral = np.concatenate([np.zeros_like(moved[:1], np.float64), np.cumsum(moved, axis=0, dtype=np.float64)])
        edge = np.linspace(0, old, size + 1)
        first = np.minimum(edge.astype(int), old - 1)
        part = (edge - first).reshape(-1, *[1] * (moved.ndim - 1))
        at_edge = integral[first] + part * moved[first]
        pixels = np.ascontiguousarray(np.moveaxis(np.diff(at_edge, axis=0) * (size / old), 0, axis), np.float32)
    return pixels


def sample(pixels: np.ndarray, uv: np.ndarray, extension: str = "REPEAT", interpolation: str = "Linear") -> np.ndarray:
    """Lookup: (h, w, c) at (..., 2+) UV -> (..., c) f32. `extension` and `interpolation` as on the image node.

    Texel centres lie at (i + 0.5) / size (docs/scene-input.md 4.3), V grows with the row.
    """
    rows, columns = pixels.shape[:2]
    x, y = uv[..., 0] * columns - 0.5, uv[..., 1] * rows - 0.5
    if interpolation == "Closest":
        return _texel(pixels, np.floor(x + 0.5), np.floor(y + 0.5), extension)
    weights = _linear if interpolation == "Linear" else _cubic
    x0, y0 = np.floor(x), np.floor(y)
    first, across = weights(np.float32(x - x0)[..., None])
    _, up = weights(np.float32(y - y0)[..., None])
    return sum(vertical * sum(horizontal * _texel(pixels, x0 + i, y0 + j, extension)
                              for i, horizontal in enumerate(across, first)) for j, vertical in enumerate(up, first))


def _linear(t):
    """Offset of the first texel, and the weight of each."""
    return 0, (1 - t, t)


def _cubic(t):
    """First offset and weights of a cubic B-spline, which "Cubic" and "Smart" use."""
    s = 1 - t
    return -1, (s ** 3 / 6, 2 / 3 - t * t * (1 - t / 2), 2 / 3 - s * s * (1 - s / 2), t ** 3 / 6)


def _texel(pixels, x, y, extension):
    column, row = (_wrap(i, n, extension) for i, n in ((x, pixels.shape[1]), (y, pixels.shape[0])))
    texels = np.take(pixels.reshape(-1, pixels.shape[2]), row * pixels.shape[1] + column, axis=0)
    if extension == "CLIP":
        inside = (x >= 0) & (x < pixels.shape[1]) & (y >= 0) & (y < pixels.shape[0])
        texels = texels * inside[..., None]
    return texels


def _wrap(index, size, extension):
    index = np.nan_to_num(index, posinf=0, neginf=0).astype(np.int32)
    if extension == "REPEAT":
        return index % size
    if extension == "MIRROR":
        index = index % (2 * size)
        return np.where(index < size, index, 2 * size - 1 - index)
    return np.clip(index, 0, size - 1)
