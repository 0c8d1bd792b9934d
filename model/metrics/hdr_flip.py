# SPDX-License-Identifier: GPL-3.0-or-later
"""FLIP of high dynamic range pictures ("Visualizing Errors in Rendered High Dynamic Range Images", Andersson et al.
2021): the largest FLIP of a pixel at any exposure at which the reference shows something.
"""
from __future__ import annotations

import numpy as np

from .. import progress
from ..color import HALF_MAX, LUMINANCE
from .flip import PIXELS_PER_DEGREE, flip_of_linear

# ACES, fitted by one fraction of polynomials: (k0 x^2 + k1 x + k2) / (k3 x^2 + k4 x + k5)
NUMERATOR, DENOMINATOR = (0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.0), (0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14)
BRIGHT = 0.85        # tone-mapped luminance of the brightest pixel at the first exposure, of the median at the last
DARKEST = 2.0 ** -23
FEWEST = 2           # exposures


def hdr_flip_map(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float = PIXELS_PER_DEGREE) -> np.ndarray:
    """Of two scene-linear pictures (H, W, 3): (H, W) f32 in [0, 1]. NaN and what is negative count as 0.

    Progress is reported, and may cancel.
    """
    reference, test = (np.clip(np.nan_to_num(picture, posinf=HALF_MAX), 0, HALF_MAX) for picture in (reference, test))
    found, steps = np.zeros(reference.shape[:2], np.float32), exposures(reference)
    for i, exposure in enumerate(steps):
        with progress.part(i / len(steps), (i + 1) / len(steps)):
            shown = (_tone_mapped(picture * np.float32(2.0 ** exposure)) for picture in (reference, test))
            found = np.maximum(found, flip_of_linear(*shown, pixels_per_degree))
    return found


def exposures(reference: np.ndarray) -> np.ndarray:
    """In stops, about one apart."""
    a, b, c = (n - BRIGHT * d for n, d in zip(NUMERATOR, DENOMINATOR))
    white = max(np.roots([a, b, c]).real)
    luminance = np.maximum(reference.astype(np.float64) @ LUMINANCE, 0)
    first, last = (np.log2(white / max(float(value), DARKEST)) for value in (luminance.max(), np.median(luminance)))
    return np.linspace(first, last, max(FEWEST, int(np.ceil(last - first))))


def _tone_mapped(linear: np.ndarray) -> np.ndarray:
    return np.clip(np.polyval(NUMERATOR, linear) / np.polyval(DENOMINATOR, linear), 0, 1)
