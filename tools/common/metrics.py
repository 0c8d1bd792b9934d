# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare two pictures: PSNR, SSIM and FLIP of display-encoded images, HDR-FLIP of linear ones."""
from __future__ import annotations

import numpy as np

from renderformer_v2.model.color import linear_to_srgb
from renderformer_v2.model.metrics.scores import psnr


def flip(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(H, W) f32 error in [0, 1] that an observer sees flipping from sRGB picture b to a, (H, W, 3) in [0, 1]."""
    import flip_evaluator

    error, _, _ = flip_evaluator.evaluate(b, a, "LDR", inputsRGB=True, applyMagma=False)
    return error[..., 0]


def hdr_flip(a: np.ndarray, b: np.ndarray) -> float:
    """Mean error at the exposures at which the linear picture b shows something, (H, W, 3)."""
    import flip_evaluator

    return float(flip_evaluator.evaluate(*(np.maximum(x, 0).astype(np.float32) for x in (b, a)), "HDR",
                                         applyMagma=False)[1])


def compare(rendered: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """Of two linear (H, W, 3) pictures: PSNR, SSIM and FLIP after sRGB encoding and clipping, HDR-FLIP as they are."""
    from skimage.metrics import structural_similarity

    a, b = linear_to_srgb(rendered), linear_to_srgb(reference)
    return {"psnr": psnr(a, b), "ssim": float(structural_similarity(a, b, channel_axis=2, data_range=1.0)),
            "flip": float(flip(a, b).mean()), "hdr_flip": hdr_flip(rendered, reference)}
