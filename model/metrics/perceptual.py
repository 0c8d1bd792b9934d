# SPDX-License-Identifier: GPL-3.0-or-later
"""LPIPS, if its package and the AlexNet weights are already installed. Nothing is downloaded for it."""
from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np

PACKAGES = ("torch", "torchvision", "lpips")
WEIGHTS = "alexnet-*.pth"  # where torchvision keeps what it downloaded


def lpips(a: np.ndarray, b: np.ndarray) -> float | None:
    """Between two sRGB-encoded pictures (H, W, 3) in [0, 1]; None where it cannot be computed."""
    if not all(map(find_spec, PACKAGES)):
        return None
    import torch
    if not any(Path(torch.hub.get_dir(), "checkpoints").glob(WEIGHTS)):
        return None
    import lpips as package
    with torch.inference_mode():
        distance = package.LPIPS(net="alex", verbose=False).eval()
        return float(distance(*(torch.from_numpy(x.astype(np.float32)).permute(2, 0, 1)[None] for x in (a, b)),
                              normalize=True))
