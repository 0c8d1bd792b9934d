# SPDX-License-Identifier: GPL-3.0-or-later
"""Prepared samples on disk, as float16 safetensors for the next epoch, made again when they are out of date."""
from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

from renderformer_v2.model.pictures import HALF_MAX

ROOT = Path(__file__).resolve().parents[2]
# The code between a file of tools.datagen and a prepared sample: if any of it changes, all are prepared again.
SOURCES = ("model/*.py", "model/guided/e*.py", "model/guided/features.py", "model/guided/guided_inputs.py",
           "model/first_hits/*.py", "model/light/**/*.py", "model/material/*.py", "model/network/inputs.py",
           "tools/datagen/sample_files.py", "tools/train/sample_cache.py", "tools/train/samples.py")
PUBLISHED = ("model/*.py", "model/material/*.py", "model/network/inputs.py", "model/published/*.py",
             "tools/datagen/sample_files.py", "tools/train/augment.py", "tools/train/published_samples.py",
             "tools/train/sample_cache.py")

# Not for half precision.
EXACT = "triangles", "texture_index", "origin", "position", "positions", "light", "exposure", "turn"


def load_or_make(file: Path, key: str, make: Callable[[], object], kinds: dict[str, type]):
    """The group of tensors in `file`, which is made first unless it is there with this key.

    kinds: the classes of its inner groups by their names, and its own as "". Floats are rounded to float16 and back.
    """
    make_if_missing(file, key, make)
    return _unflatten(load_file(file), kinds, "")


def make_if_missing(file: Path, key: str, make: Callable[[], object]) -> None:
    """As `load_or_make`, without reading the file."""
    if not is_current(file, key):
        group, temporary = make(), file.with_suffix(f".{os.getpid()}.tmp")
        file.parent.mkdir(parents=True, exist_ok=True)
        save_file(_flatten(group), temporary, metadata={"key": key})
        temporary.replace(file)


def is_current(file: Path, key: str) -> bool:
    try:
        with safe_open(file, "pt") as opened:
            return opened.metadata().get("key") == key
    except (OSError, SafetensorError):  # not there, or cut short
        return False


def cache_path(path: Path, cache: Path, kind: str = "") -> Path:
    """The file of the cache for the sample at `path`; kind: a suffix where it is prepared in several ways."""
    return cache / f"{path.stem}-{_digest(str(path.resolve()))}{kind}.safetensors"


def sample_key(path: Path, sources: tuple[str, ...] = SOURCES) -> str:
    """Changes with the sample's file and with the code that prepares it. Raises OSError if there is no such file."""
    status = path.stat()
    return f"{status.st_size}-{status.st_mtime_ns}-{code_version(sources)}"


@functools.cache
def code_version(sources: tuple[str, ...] = SOURCES) -> str:
    return _digest("".join(file.read_text(encoding="utf-8") for pattern in sources
                           for file in sorted(ROOT.glob(pattern))))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def stored(value: Tensor, name: str) -> Tensor:
    """A field's tensor in half precision, if that is exact enough for it."""
    half = value.is_floating_point() and name not in EXACT
    return value.clamp(-HALF_MAX, HALF_MAX).half() if half else value


def _flatten(part, prefix: str = "") -> dict[str, Tensor]:
    flat = {}
    for f in fields(part):
        value = getattr(part, f.name)
        if isinstance(value, Tensor):
            flat[prefix + f.name] = stored(value, f.name).contiguous()
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
