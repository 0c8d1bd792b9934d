# SPDX-License-Identifier: GPL-3.0-or-later
"""The loaded network, kept between renders: Blender makes a new engine for every frame."""
from __future__ import annotations

import gc
import importlib
from concurrent.futures import Future

from ..model import background
from ..model.errors import CheckpointError
from .setup import importing

_cached: dict[tuple[str, str, str], object] = {}  # at most one: networks are large


def begin_import() -> Future:
    """Import PyTorch and the network's code, about 2 s the first time, while the scene is prepared."""
    def load():
        importing.import_packages()
        return importlib.import_module("..model.renderer", __package__)

    return background.begin(load)


def renderer(weights: str, device: str, precision: str, progress):
    """The model.renderer.Renderer for these settings, loaded at the first call.

    Raises CheckpointError when the weights, the device or the precision cannot be used, and what progress(text,
    fraction) raises.
    """
    key = (weights, device, precision)
    if key not in _cached:
        network = background.finish(begin_import(), lambda: progress("Loading PyTorch", 0.0))
        free()
        try:
            _cached[key] = network.Renderer(weights, device=device, precision=precision)
        except ValueError as error:
            raise CheckpointError(str(error)) from error
    return _cached[key]


def is_loaded() -> bool:
    return bool(_cached)


def free() -> None:
    """Give the network's memory back, on the GPU too."""
    if not _cached:
        return  # and PyTorch may be half imported
    _cached.clear()
    gc.collect()
    import torch
    if torch.cuda.is_available():
        torch.cuda.empty_cache()
