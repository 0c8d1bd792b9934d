# SPDX-License-Identifier: GPL-3.0-or-later
"""Prepared samples on disk, as float16 safetensors for the next epoch."""
from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

from renderformer_v2.model.color import HALF_MAX

# Not for half precision.
EXACT = ("triangles", "texture_index", "origin", "position", "positions", "light", "exposure")


def kept(stored: Path, key: str, make: Callable[[], object], kinds: dict[str, type]):
    """The group of tensors that is `stored`, made and stored before if it is not there with this key.

    kinds: the classes of its inner groups by their names, and its own as "". What is returned went through float16.
    """
    keep(stored, key, make)
    return _unflatten(load_file(stored), kinds, "")


def keep(stored: Path, key: str, make: Callable[[], object]) -> None:
    """The same without reading it."""
    if not is_current(stored, key):
        temporary = stored.with_suffix(f".{os.getpid()}.tmp")
        save_file(_flatten(make()), temporary, metadata={"key": key})
        temporary.replace(stored)


def is_current(stored: Path, key: str) -> bool:
    try:
        with safe_open(stored, "pt") as file:
            return file.metadata().get("key") == key
    except (OSError, SafetensorError):  # not there, or cut short
        return False


def _flatten(part, prefix: str = "") -> dict[str, Tensor]:
    flat = {}
    for f in fields(part):
        value = getattr(part, f.name)
        if isinstance(value, Tensor):
            half = value.is_floating_point() and f.name not in EXACT
            flat[prefix + f.name] = (value.clamp(-HALF_MAX, HALF_MAX).half() if half else value).contiguous()
        elif value is not None:
            flat |= _flatten(value, f"{prefix}{f.name}.")
    return flat


def _unflatten(flat: dict[str, Tensor], kinds: dict[str, type], name: str):
    values = {}
    for f in fields(kinds[name]):
        inner = {k.removeprefix(f"{f.name}."): v for k, v in flat.items() if k.startswith(f"{f.name}.")}
        if inner:
            values[f.name] = _unflatten(inner, kinds, f.name)
        else:
            value = flat.get(f.name)
            values[f.name] = value.float() if value is not None and value.is_floating_point() else value
    return kinds[name](**values)
