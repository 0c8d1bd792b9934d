# SPDX-License-Identifier: GPL-3.0-or-later
"""Multilayer EXR files as Blender writes them."""
from __future__ import annotations

from pathlib import Path

import numpy as np


def read_pass(path: Path, name: str, channels: str, layer: str | None = None) -> np.ndarray:
    """(H, W, len(channels)) f32 of a pass of a view layer (the first), row 0 on top: ("Combined", "RGB"), for example.

    Raises KeyError naming the file when there is no such pass.
    """
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        found = {key: channel.pixels for key, channel in file.channels().items()}
    ending = f".{name}.{channels[0]}"
    layers = [key.removesuffix(ending) for key in found if key.endswith(ending) and layer in (None, key[:-len(ending)])]
    if not layers:
        raise KeyError(f"{path} has no pass {name}")
    return np.stack([found[f"{min(layers)}.{name}.{c}"] for c in channels], axis=-1).astype(np.float32)
