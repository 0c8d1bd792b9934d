# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare two pictures: PSNR, SSIM and FLIP of display-encoded images."""
from __future__ import annotations

import numpy as np

from renderformer_v2.model.color import linear_to_srgb
from renderformer_v2.model.metrics import psnr


def flip(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(H, W) f32 error in [0, 1] that an observer sees flipping from sRGB picture b to a, (H, W, 3) in [0, 1]."""
    import flip_evaluator

    error, _, _ = flip_evaluator.evaluate(b, a, "LDR", inputsRGB=True, applyMagma=False)
    return error[..., 0]


def compare(rendered: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """PSNR, SSIM and FLIP of two linear (H, W, 3) pictures after sRGB encoding and clipping."""
    from skimage.metrics import structural_similarity

    a, b = linear_to_srgb(rendered), linear_to_srgb(reference)
    return {"psnr": psnr(a, b), "ssim": float(structural_similarity(a, b, channel_axis=2, data_range=1.0)),
            "flip": float(flip(a, b).mean())}
