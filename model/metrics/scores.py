# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare two pictures: PSNR, SSIM, FLIP and noise in numpy, because Blender's Python has no library for them.

LPIPS needs a network of its own: it is computed where its package and the AlexNet weights are installed already.
"""
from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from .. import progress
from ..pictures import box_sums, linear_to_srgb
from .flip import flip_map, hdr_flip_map

WINDOW = 7                       # pixels, the side of SSIM's square window
C1, C2 = 0.01 ** 2, 0.03 ** 2    # SSIM's constants for values in [0, 1]
SMALLEST_ERROR = 1e-10           # mean square; equal pictures are 100 dB apart

LPIPS_PACKAGES = ("torch", "torchvision", "lpips")
LPIPS_WEIGHTS = "alexnet-*.pth"  # where torchvision keeps what it downloaded

NOISE_BLOCK = 8      # pixels along the side of a square that is judged as one
NOISE_TRIMMED = 0.2  # share of blocks left out at either end: edges that one picture smooths look like noise there
MASK_SQUARES = 36.0  # sum of the squares of the mask's numbers
FEWEST_BLOCKS = 16


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


def compare(a: np.ndarray, b: np.ndarray) -> Closeness:
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
        flip = flip_map(b, a)
    with progress.part(0.3, 1.0):
        hdr_flip = hdr_flip_map(*linear)
    progress.report(1.0)
    return Closeness(psnr(a, b), similarity, float(flip.mean()), float(hdr_flip.mean()), lpips(a, b), flip)


def lpips(a: np.ndarray, b: np.ndarray) -> float | None:
    """Between two sRGB-encoded pictures (H, W, 3) in [0, 1]; None where it cannot be computed."""
    if not all(map(find_spec, LPIPS_PACKAGES)):
        return None
    import torch
    if not any(Path(torch.hub.get_dir(), "checkpoints").glob(LPIPS_WEIGHTS)):
        return None
    import lpips as package
    with torch.inference_mode():
        distance = package.LPIPS(net="alex", verbose=False).eval()
        return float(distance(*(torch.from_numpy(x.astype(np.float32)).permute(2, 0, 1)[None] for x in (a, b)),
                              normalize=True))


def excess_noise(a: np.ndarray, b: np.ndarray) -> float:
    """By how much the variance of the noise in `b` exceeds that in `a`, two pictures (H, W, 3) of one view; at least 0.

    If `b` is a reference, no render comes closer to it than that. 0 where pictures are too small to tell. Noise is what
    no neighbour predicts (Immerkaer 1996, a Laplacian that shading does not reach); textures are in both.
    """
    difference = _squared_mask(b) - _squared_mask(a)
    height, width = (size // NOISE_BLOCK * NOISE_BLOCK for size in difference.shape[:2])
    blocks = difference[:height, :width].reshape(height // NOISE_BLOCK, NOISE_BLOCK, width // NOISE_BLOCK, NOISE_BLOCK,
                                                 -1).mean((1, 3, 4))
    if blocks.size < FEWEST_BLOCKS:
        return 0.0
    trimmed = int(blocks.size * NOISE_TRIMMED)
    middle = np.sort(blocks, axis=None)[trimmed:-trimmed]
    return max(float(middle.mean()), 0.0) / MASK_SQUARES


def _squared_mask(picture: np.ndarray) -> np.ndarray:
    """(H - 2, W - 2, 3) squares of the mask [1 -2 1] in both directions."""
    for _ in range(2):
        picture = (picture[2:] - 2 * picture[1:-1] + picture[:-2]).swapaxes(0, 1)
    return picture.astype(np.float64) ** 2
