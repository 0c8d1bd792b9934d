# SPDX-License-Identifier: GPL-3.0-or-later
"""The loaded network, kept between renders: Blender makes a new engine for every frame."""
from __future__ import annotations

import gc
import sys

from ..model.errors import CheckpointError

_cached: dict[tuple[str, str, str], object] = {}  # at most one: networks are large


def renderer(weights: str, device: str, precision: str):
    """The model.renderer.Renderer for these settings, loaded at the first call.

    Raises CheckpointError when the weights, the device or the precision cannot be used.
    """
    key = (weights, device, precision)
    if key not in _cached:
        from ..model.renderer import Renderer
        free()
        try:
            _cached[key] = Renderer(weights, device=device, precision=precision)
        except ValueError as error:
            raise CheckpointError(str(error)) from error
    return _cached[key]


def is_loaded() -> bool:
    return bool(_cached)


def free() -> None:
    """Give the network's memory back, on the GPU too."""
    _cached.clear()
    gc.collect()
    torch = sys.modules.get("torch")
    if torch is not None and torch.cuda.is_available():
        torch.cuda.empty_cache()
