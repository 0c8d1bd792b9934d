# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the loaded network and the last encoded scene between renders, because Blender makes an engine per frame."""
from __future__ import annotations

import gc
import hashlib
import importlib
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import fields
from pathlib import Path

import numpy as np

from ...model.compute import threads
from ...model.errors import CheckpointError
from ...model.progress import part
from ...model.published.bundle_files import AUTOMATIC
from ...model.scene import RenderScene
from ...model.weights.presets import weights_folder
from ..setup import importing, published_weights, wheels

SUFFIXES = (".safetensors", ".json", ".yaml", ".yml")  # of weights and what describes them

_cached: dict[tuple, object] = {}   # at most one model.renderer.Renderer: networks are large
_encoded: dict[tuple, object] = {}  # at most one model.renderer.EncodedScene
holders: list[Callable[[], None]] = []  # called before the network's memory is freed; they drop what refers to it


def begin_import() -> Future:
    """Import PyTorch and the network's code, about 2 s the first time, while the scene is prepared."""
    def load():
        importing.import_packages()
        return importlib.import_module("...model.renderer", __package__)

    return threads.begin_import(load)


def renderer(weights: str, device: str, precision: str, transformer: str = AUTOMATIC, rays: bool = True):
    """The model.renderer.Renderer for these settings, loaded at the first call and when its files have changed.

    Raises CheckpointError when the weights, the device or the precision cannot be used.
    """
    key = (weights, device, precision, transformer, rays, _state_of_files(weights_folder(weights)))
    if key not in _cached:
        with part(0.0, 1.0, "Loading PyTorch"):
            network = threads.finish(begin_import())
        free()
        try:
            _cached[key] = network.Renderer(weights, device, precision, transformer,
                                            published_weights.latents_file(), rays)
        except ValueError as error:
            raise CheckpointError(str(error)) from error
    return _cached[key]


def prepare(network, scene: RenderScene, picture_size: int) -> None:
    """Encode the textures that `encoded` will need, for this render and for later ones."""
    if _key(network, scene, picture_size) not in _encoded:
        network.prepare(scene)


def encoded(network, scene: RenderScene, picture_size: int):
    """The model.renderer.EncodedScene of `scene` by that renderer, from the cache if nothing has changed."""
    key = _key(network, scene, picture_size)
    if key not in _encoded:
        _encoded.clear()
        _encoded[key] = network.encode(scene, picture_size)
    return _encoded[key]


def _key(network, scene: RenderScene, picture_size: int) -> tuple:
    return id(network), fingerprint(scene), network.pipeline.variant(picture_size)


def is_loaded() -> bool:
    return bool(_cached)


def free() -> None:
    """Free the network's memory, on the GPU too."""
    if not _cached:
        return  # and PyTorch may be half imported
    _cached.clear()
    _encoded.clear()
    for release in holders:
        release()
    gc.collect()
    import torch
    if torch.cuda.is_available():
        torch.cuda.empty_cache()
    if torch.backends.mps.is_available():
        torch.mps.empty_cache()


def explain_unused_card(network) -> str:
    """Why that renderer does not use an NVIDIA card that is there, and what to do; "" where there is none."""
    if network.device.type == "cuda":
        return ""
    from ...model.compute.devices import explain_unused_card
    return explain_unused_card(wheels.has_nvidia_driver())


def leave_gpu() -> None:
    """Free the memory of a GPU; a network on the processor stays."""
    if any(network.device.type != "cpu" for network in _cached.values()):
        free()


def fingerprint(scene: RenderScene) -> bytes:
    """Changes whenever the content of the scene does."""
    digest = hashlib.blake2b(digest_size=16)
    _update(digest, scene)
    return digest.digest()


def _update(digest, group) -> None:
    for f in fields(group):
        value = getattr(group, f.name)
        if isinstance(value, np.ndarray):
            digest.update(f"{f.name}{value.shape}{value.dtype}".encode())
            digest.update(np.ascontiguousarray(value))
        elif value is not None:
            _update(digest, value)


def _state_of_files(folder: Path) -> tuple:
    """Names, sizes and times of the weights; what cannot be read is for the loader to explain."""
    try:
        files = sorted(path for pattern in ("*", "*/*") for path in folder.glob(pattern) if path.suffix in SUFFIXES)
        return tuple((str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in files)
    except OSError:
        return ()
