# SPDX-License-Identifier: GPL-3.0-or-later
"""The loaded network, kept between renders: Blender makes a new engine for every frame.

PyTorch and weights are loaded on a thread of their own, so that Cycles works meanwhile and Esc is honoured.
"""
from __future__ import annotations

import gc
import importlib
from concurrent.futures import Future, ThreadPoolExecutor, wait

from ..model.errors import CheckpointError

POLL = 0.05  # seconds

_loader = ThreadPoolExecutor(1, "RenderFormer-V2 loader")
_loaded: dict[tuple[str, str, str], Future] = {}  # at most one: networks are large


def begin_import() -> None:
    """Import PyTorch and the network's code, about 2 s the first time, while the scene is prepared."""
    _loader.submit(_network_module)


def renderer(weights: str, device: str, precision: str, progress):
    """The model.renderer.Renderer for these settings, loaded at the first call.

    Raises CheckpointError when the weights, the device or the precision cannot be used, and what progress(text,
    fraction) raises; then the loading goes on for the next call.
    """
    key = (weights, device, precision)
    if key not in _loaded:
        free()
        _loaded[key] = _loader.submit(_load, *key)
    while not wait(_loaded.values(), POLL).done:
        progress("Loading the network", 0.0)
    try:
        return _loaded[key].result()
    except Exception:
        free()
        raise


def is_loaded() -> bool:
    return bool(_loaded)


def free() -> None:
    """Give the network's memory back, on the GPU too."""
    if not _loaded:
        return  # and PyTorch may be half imported
    wait(_loaded.values())
    _loaded.clear()
    gc.collect()
    import torch
    if torch.cuda.is_available():
        torch.cuda.empty_cache()


def _network_module():
    return importlib.import_module("..model.renderer", __package__)


def _load(weights: str, device: str, precision: str):
    try:
        return _network_module().Renderer(weights, device=device, precision=precision)
    except ValueError as error:
        raise CheckpointError(str(error)) from error
