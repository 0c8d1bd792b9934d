# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare two pictures: PSNR, SSIM and FLIP in numpy, because Blender's Python has no library for them.

LPIPS needs its own network; it is available if its package is installed.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import progress
from ..box_filter import box_sums
from ..color import linear_to_srgb
from .flip import flip_map
from .hdr_flip import hdr_flip_map
from .perceptual import lpips

WINDOW = 7                       # pixels, the side of SSIM's square window
C1, C2 = 0.01 ** 2, 0.03 ** 2    # SSIM's constants for values in [0, 1]
SMALLEST_ERROR = 1e-10           # mean square; equal pictures are 100 dB apart


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """dB between two pictures (H, W, 3) in [0, 1]."""
    return float(-10 * np.log10(max(float(np.mean((a - b) ** 2, dtype=np.float64)), SMALLEST_ERROR)))


def ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Structural similarity of two pictures (H, W, 3) in [0, 1]: uniform windows, the mean over channels.

    Raises ValueError for pictures smaller than the window.
    """
    if min(a.shape[:2]) < WINDOW:
        raise ValueError(f"SSIM needs pictures of at least {WINDOW} x {WINDOW} pixels")
    similarities = []
    for c in range(a.shape[-1]):
        progress.report(c / a.shape[-1])
        similarities.append(_ssim_of_channel(a[..., c], b[..., c]))
    return float(np.mean(similarities))


def _ssim_of_channel(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a.astype(np.float64), b.astype(np.float64)
    mean_a, mean_b = _window_means(a), _window_means(b)
    unbiased = WINDOW ** 2 / (WINDOW ** 2 - 1)
    variance_a = unbiased * (_window_means(a * a) - mean_a ** 2)
    variance_b = unbiased * (_window_means(b * b) - mean_b ** 2)
    covariance = unbiased * (_window_means(a * b) - mean_a * mean_b)
    luminance = (2 * mean_a * mean_b + C1) / (mean_a ** 2 + mean_b ** 2 + C1)
    structure = (2 * covariance + C2) / (variance_a + variance_b + C2)
    return float(np.mean(luminance * structure))


def _window_means(x: np.ndarray) -> np.ndarray:
    """Means over the windows that lie inside: (H, W) -> (H - 6, W - 6)."""
    inside = (slice(WINDOW // 2, -(WINDOW // 2)),) * 2
    return box_sums(x, WINDOW // 2)[inside] / WINDOW ** 2


@dataclass(frozen=True)
class Closeness:
    """How close two pictures are."""

    psnr: float           # dB
    ssim: float
    flip: float           # mean of the map
    hdr_flip: float       # mean of that of all exposures, values above 1 included
    lpips: float | None   # None where its package is not there
    flip_map: np.ndarray  # (H, W) f32 in [0, 1], row 0 on top


def closeness(a: np.ndarray, b: np.ndarray) -> Closeness:
    """Metrics of two scene-linear pictures (H, W, 3), b being the reference, after sRGB encoding and clipping but for
    HDR-FLIP.

    Progress is reported, and may cancel. Raises ValueError for pictures of different sizes or too small for SSIM.
    """
    if a.shape != b.shape:
        raise ValueError(f"The pictures have {a.shape[1]} x {a.shape[0]} and {b.shape[1]} x {b.shape[0]} pixels")
    linear = b, a
    a, b = linear_to_srgb(a), linear_to_srgb(b)
    with progress.part(0.0, 0.2):
        similarity = ssim(a, b)
    with progress.part(0.2, 0.3):
        seen = flip_map(b, a)
    with progress.part(0.3, 1.0):
        at_exposures = hdr_flip_map(*linear)
    progress.report(1.0)
    return Closeness(psnr(a, b), similarity, float(seen.mean()), float(at_exposures.mean()), lpips(a, b), seen)
