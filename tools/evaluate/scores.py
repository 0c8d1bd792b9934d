# SPDX-License-Identifier: GPL-3.0-or-later
"""The figures of one scene, and of all."""
from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch

from renderformer_v2.model.pictures import linear_to_srgb
from tools.common.lpips import load_lpips
from tools.common.metrics import compare
from tools.train.losses import structure_loss

METRICS = ("psnr", "ssim", "flip", "hdr_flip")


@dataclass
class Evaluation:
    """One scene: its entry in report.json, and per view linear (H, W, 3) pictures, by name.

    Every view has "ours" and "reference"; "equal", Cycles in about the same time, where it is known.
    """

    scores: dict
    views: list[dict[str, np.ndarray]]


def compute_scores(pictures: list[np.ndarray], references: list[np.ndarray], **more: float) -> dict[str, float]:
    """Mean metrics of linear (H, W, 3) pictures against their references; `more` is added, rounded."""
    views = [compare(a, b) for a, b in zip(pictures, references, strict=True)]
    return {key: float(np.mean([v[key] for v in views])) for key in METRICS} | {
        key: round(value, 3) for key, value in more.items()}


def perceptual(rendered: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """The perceptual distance of two linear (H, W, 3) pictures, after sRGB encoding and clipping.

    "lpips" is by VGG, where its weights are on this machine; else it is "structure", by tools/train/losses.py.
    """
    a, b = (torch.from_numpy(linear_to_srgb(x)).movedim(-1, 0)[None] for x in (rendered, reference))
    with torch.inference_mode():
        return {"lpips" if _vgg() else "structure": float((_vgg() or structure_loss)(a, b))}


def perceptual_column(scores: list[dict[str, float]]) -> tuple[str, str]:
    """Key and title of what `perceptual` gave for all of several pictures."""
    if all("lpips" in each for each in scores):
        return "lpips", "LPIPS"
    return "structure", "structure (for LPIPS)"


@cache
def _vgg():
    return load_lpips("vgg")


def compute_means(scenes: list[dict]) -> dict:
    """Every metric of the scenes, the worst PSNR, the seconds if all have them; the same of what all have "beside"."""
    means = {key: float(np.mean([s[key] for s in scenes])) for key in METRICS}
    means["worst_psnr"] = min(s["psnr"] for s in scenes)
    if all("seconds" in s for s in scenes):
        means["seconds"] = round(float(np.mean([s["seconds"] for s in scenes])), 3)
    names = set.intersection(*(set(s.get("beside", {})) for s in scenes))
    return means | {name: compute_means([s["beside"][name] for s in scenes]) for name in sorted(names)}
