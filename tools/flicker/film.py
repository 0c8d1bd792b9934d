# SPDX-License-Identifier: GPL-3.0-or-later
"""An animated picture of what several engines make of the same frames, side by side."""
from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image

from renderformer_v2.model.color import linear_to_srgb
from tools.picture import write_whole

SECONDS = 0.125  # of a frame
QUALITY = 95     # of 100


def film(path: Path, frames: Iterable[Iterable[np.ndarray]]) -> None:
    """Write a .webp of frames, each of which is pictures (H, W, 3) f32, linear. Raises OSError naming `path`."""
    shown = [Image.fromarray(np.hstack([(linear_to_srgb(picture) * 255 + 0.5).astype(np.uint8)
                                        for picture in pictures])) for pictures in frames]
    write_whole(path, lambda temporary: shown[0].save(
        temporary, save_all=True, append_images=shown[1:], duration=round(1000 * SECONDS), loop=0, quality=QUALITY,
        method=6))
