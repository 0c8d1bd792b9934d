# SPDX-License-Identifier: GPL-3.0-or-later
"""The loaded network, kept between renders: Blender makes a new engine for every frame."""
from __future__ import annotations

import gc
import importlib
from threading import Thread

from ..model.errors import CheckpointError

POLL = 0.05  # seconds

_cached: dict[tuple[str, str, str], object] = {}  # at most one: networks are large
_importing: list[Thread] = []                     # at most one: PyTorch is imported once per process


def begin_import() -> None:
    """Import PyTorch and the network's code, about 2 s, while Blender and Cycles prepare the scene."""
    if not _importing:
        _importing.append(Thread(target=_import, daemon=True, name="RenderFormer-V2 import"))
        _importing[0].start()


def renderer(weights: str, device: str, precision: str, progress):
    """The model.renderer.Renderer for these settings, loaded at the first call.

    Raises CheckpointError when the weights, the device or the precision cannot be used, and what progress(text,
    fraction) raises.
    """
    key = (weights, device, precision)
    if key not in _cached:
        begin_import()
        while _importing[0].is_alive():
            progress("Loading PyTorch", 0.0)
            _importing[0].join(POLL)
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
    if not _cached:
        return  # and PyTorch may be half imported
    _cached.clear()
    gc.collect()
    import torch
    if torch.cuda.is_available():
        torch.cuda.empty_cache()


def _import() -> None:
    try:
        importlib.import_module("..model.renderer", __package__)
    except Exception:
        pass  # the render imports it once more and says what is wrong
