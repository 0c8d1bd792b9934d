# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures as arrays: sums over the squares around pixels, and horizontal bands, so that a large picture costs little
more memory than a small one.
"""
from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .progress import report

BAND_PIXELS = 1 << 18  # of a band; also what lies between two looks at the Esc key


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


def bands(height: int, width: int, margin: int, pixels: int = 0, multiple: int = 1) -> Iterator[tuple[slice, slice]]:
    """For each band: its rows with `margin` more on either side, as far as there are, and which of those are its own.

    pixels: of a band without its margins, BAND_PIXELS for 0. multiple: the first row of a band is a multiple of it.
    Reports progress, which may cancel.
    """
    rows = max((pixels or BAND_PIXELS) // width // multiple, 1) * multiple
    for begin in range(0, height, rows):
        report(begin / height)
        first, end = max(begin - margin, 0), min(begin + rows, height)
        yield slice(first, min(end + margin, height)), slice(begin - first, end - first)
