# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures as arrays: sRGB encoding, sums over the squares around pixels, smaller ones, and horizontal bands, so that
a large picture costs little more memory than a small one.
"""
from __future__ import annotations

import numpy as np

BAND_PIXELS = 1 << 18  # of a band, and so between two checks of the Esc key
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of scene-linear RGB
HALF_MAX = 65504.0  # the largest half float


def box_sums(x: np.ndarray, radius: int) -> np.ndarray:
    """Sums over the 2 radius + 1 pixels squared around each pixel of (H, W, ...); nothing lies outside."""
    for axis in (0, 1):
        margins, size = [(radius, radius) if i == axis else (0, 0) for i in range(x.ndim)], x.shape[axis]
        padded = np.pad(x, margins)
        x = sum(padded[(*[slice(None)] * axis, slice(i, i + size))] for i in range(2 * radius + 1))
    return x


def box_means(x: np.ndarray, radius: int) -> np.ndarray:
    """Means over those pixels of the squares that lie inside of the picture."""
    return box_sums(x, radius) / box_sums(np.ones((*x.shape[:2], *[1] * (x.ndim - 2)), x.dtype), radius)


def bands(height: int, width: int, margin: int, pixels: int = 0, multiple: int = 1) -> list[tuple[slice, slice]]:
    """For each band: its rows with `margin` more on either side, as far as there are, and which of those are its own.

    pixels: of a band without its margins, BAND_PIXELS for 0. multiple: the first row of a band is a multiple of it.
    """
    rows, result = max((pixels or BAND_PIXELS) // width // multiple, 1) * multiple, []
    for begin in range(0, height, rows):
        first, end = max(begin - margin, 0), min(begin + rows, height)
        result.append((slice(first, min(end + margin, height)), slice(begin - first, end - first)))
    return result


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """sRGB values in [0, 1] -> scene-linear, any shape."""
    return np.where(encoded <= 0.04045, encoded / 12.92, (np.maximum(encoded, 0) * (1 / 1.055) + 0.055 / 1.055) ** 2.4)


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Scene-linear -> sRGB, clipped to [0, 1]; f32, any shape. NaN becomes 0."""
    x = np.clip(np.nan_to_num(linear), 0, 1).astype(np.float32)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def to_half(x: np.ndarray) -> np.ndarray:
    """As f16, clipped to what that can hold."""
    return np.clip(x, -HALF_MAX, HALF_MAX).astype(np.float16)


def resize(pixels: np.ndarray, height: int, width: int) -> np.ndarray:
    """(H, W, C) -> (height, width, C), each the mean of the pixels that it covers, or one of them."""
    for axis, size in ((0, height), (1, width)):
        start = np.arange(size) * pixels.shape[axis] // size
        counts = np.maximum(np.diff([*start, pixels.shape[axis]]), 1)
        shape = [-1 if i == axis else 1 for i in range(3)]
        pixels = np.add.reduceat(pixels, start, axis=axis) / counts.astype(np.float32).reshape(shape)
    return pixels
