# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of the report: what was rendered, and where it differs."""
from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from renderformer_v2.model.color import linear_to_srgb
from tools.metrics import flip

from .scores import Evaluation

AMPLIFIED = 4  # times, the difference
TITLES = {
    "ours": "RenderFormer-V2",
    "reference": "Cycles, reference",
    "equal": "Cycles, equal time",
    "difference": f"difference × {AMPLIFIED}",
    "flip": "FLIP",
}


class Picture(NamedTuple):
    kind: str  # a key of TITLES
    file: str  # relative to the report
    width: int
    height: int


def write_pictures(evaluation: Evaluation, report: Path, scene: str) -> list[list[Picture]]:
    """Write PNGs below `report`, sRGB-encoded and clipped to [0, 1]; those of each view, in the order of TITLES."""
    from skimage.io import imsave

    folder = Path("pictures") / scene
    (report / folder).mkdir(parents=True, exist_ok=True)
    found = []
    for index, view in enumerate(evaluation.views, 1):
        pixels = with_errors({kind: linear_to_srgb(linear) for kind, linear in view.items()})
        row = []
        for kind in sorted(pixels, key=list(TITLES).index):
            file = folder / f"{index}-{kind}.png"
            imsave(report / file, (pixels[kind] * 255 + 0.5).astype(np.uint8), check_contrast=False)
            row.append(Picture(kind, file.as_posix(), pixels[kind].shape[1], pixels[kind].shape[0]))
        found.append(row)
    return found


def with_errors(view: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """sRGB (H, W, 3) pictures of one view, and where "ours" differs from "reference"."""
    from matplotlib import colormaps

    ours, reference = view["ours"], view["reference"]
    return view | {"difference": np.clip(np.abs(ours - reference) * AMPLIFIED, 0, 1),
                   "flip": colormaps["magma"](flip(ours, reference))[..., :3]}
