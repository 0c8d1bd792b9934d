# SPDX-License-Identifier: GPL-3.0-or-later
"""How close two pictures are: PSNR, SSIM and FLIP of display-encoded images."""
from __future__ import annotations

import numpy as np

from renderformer_v2.model.color import linear_to_srgb


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """dB between two images in [0, 1]."""
    return float(-10 * np.log10(max(float(np.mean((a - b) ** 2)), 1e-10)))


def compare(rendered: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """PSNR, SSIM and FLIP of two linear (H, W, 3) pictures after sRGB encoding and clipping."""
    from skimage.metrics import structural_similarity

    a, b = linear_to_srgb(rendered), linear_to_srgb(reference)
    mean_flip = _flip(b, a, magma=False)[1]
    return {"psnr": psnr(a, b), "ssim": float(structural_similarity(a, b, channel_axis=2, data_range=1.0)),
            "flip": float(mean_flip)}


def flip_map(rendered: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """(H, W, 3) picture of FLIP for the same, 0 black to 1 yellow."""
    return _flip(linear_to_srgb(reference), linear_to_srgb(rendered), magma=True)[0]


def _flip(reference: np.ndarray, rendered: np.ndarray, magma: bool) -> tuple[np.ndarray, float]:
    import flip_evaluator
    found, mean, _ = flip_evaluator.evaluate(reference, rendered, "LDR", inputsRGB=True, applyMagma=magma)
    return found, mean
