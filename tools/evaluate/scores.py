# SPDX-License-Identifier: GPL-3.0-or-later
"""The figures of one scene, and of all."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tools.common.metrics import compare

METRICS = ("psnr", "ssim", "flip")


@dataclass
class Evaluation:
    """One scene: its entry in report.json, and per view linear (H, W, 3) pictures, by name.

    Every view has "ours" and "reference"; "equal", Cycles in about the same time, where it is known.
    """

    scores: dict
    views: list[dict[str, np.ndarray]]


def scores(pictures: list[np.ndarray], references: list[np.ndarray], **more: float) -> dict[str, float]:
    """Mean metrics of linear (H, W, 3) pictures against their references; `more` is added, rounded."""
    views = [compare(a, b) for a, b in zip(pictures, references, strict=True)]
    return {key: float(np.mean([v[key] for v in views])) for key in METRICS} | {
        key: round(value, 3) for key, value in more.items()}


def mean(scenes: list[dict]) -> dict:
    """Every metric of the scenes, the worst PSNR, the seconds if they are known; also of what all are set beside."""
    found = {key: float(np.mean([s[key] for s in scenes])) for key in METRICS}
    found["worst_psnr"] = min(s["psnr"] for s in scenes)
    if all("seconds" in s for s in scenes):
        found["seconds"] = round(float(np.mean([s["seconds"] for s in scenes])), 3)
    names = set.intersection(*(set(s.get("beside", {})) for s in scenes))
    return found | {name: mean([s["beside"][name] for s in scenes]) for name in sorted(names)}
