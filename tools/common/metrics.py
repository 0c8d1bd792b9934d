# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare two pictures: PSNR, SSIM and FLIP of sRGB-encoded images, HDR-FLIP of linear ones.

By the libraries of these metrics' authors; what the add-on shows is by its own code (model/metrics).
"""
from __future__ import annotations

import numpy as np

from renderformer_v2.model.metrics.scores import psnr
from renderformer_v2.model.pictures import linear_to_srgb

AMPLIFIED = 4  # times, a difference that is shown


def flip(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(H, W) f32 error in [0, 1] that an observer sees flipping from sRGB picture b to a, (H, W, 3) in [0, 1]."""
    import flip_evaluator

    error, _, _ = flip_evaluator.evaluate(b, a, "LDR", inputsRGB=True, applyMagma=False)
    return error[..., 0]


def hdr_flip(a: np.ndarray, b: np.ndarray) -> float:
    """Mean error at the exposures at which the linear picture b shows something, (H, W, 3).

    Where b is black no exposure is known, with which the library never ends: the share of pixels of a that are not.
    """
    import flip_evaluator

    if not (b > 0).any():
        return float((a > 0).any(axis=-1).mean())
    return float(flip_evaluator.evaluate(*(np.maximum(x, 0).astype(np.float32) for x in (b, a)), "HDR",
                                         applyMagma=False)[1])


def compare(rendered: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """PSNR, SSIM and FLIP of linear (H, W, 3) pictures after sRGB encoding and clipping, and HDR-FLIP without."""
    from skimage.metrics import structural_similarity

    a, b = linear_to_srgb(rendered), linear_to_srgb(reference)
    return {"psnr": psnr(a, b), "ssim": float(structural_similarity(a, b, channel_axis=2, data_range=1.0)),
            "flip": float(flip(a, b).mean()), "hdr_flip": hdr_flip(rendered, reference)}


def add_error_pictures(view: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """sRGB (H, W, 3) pictures of one view, with "difference" and "flip" of "ours" and "reference" added."""
    from matplotlib import colormaps

    ours, reference = view["ours"], view["reference"]
    return view | {"difference": np.clip(np.abs(ours - reference) * AMPLIFIED, 0, 1),
                   "flip": colormaps["magma"](flip(ours, reference))[..., :3]}
