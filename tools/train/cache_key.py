# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the file of the cache that belongs to a sample, and whether it is still up to date."""
from __future__ import annotations

import functools
import hashlib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# The code between a file of tools.datagen and a prepared sample: if any of it changes, all are prepared again.
SOURCES = ("model/camera.py", "model/clusters.py", "model/color.py", "model/environment.py", "model/fields.py",
           "model/geometry.py", "model/guided/**/*.py", "model/material/reflectance.py", "model/network/inputs.py",
           "model/normalize.py", "model/renderer.py", "model/scene.py", "tools/datagen/shards.py",
           "tools/train/antialiasing.py", "tools/train/kept.py", "tools/train/samples.py")
PUBLISHED = ("model/camera.py", "model/color.py", "model/fields.py", "model/geometry.py", "model/material/*.py",
             "model/network/inputs.py", "model/normalize.py", "model/published/*.py", "model/renderer.py",
             "model/scene.py", "tools/datagen/shards.py", "tools/train/kept.py", "tools/train/published_samples.py")


def stored_path(path: Path, cache: Path, kind: str = "") -> Path:
    """The one file that the cache holds for the sample at `path` as prepared in this way, whatever is in it."""
    return cache / f"{path.stem}-{_digest(str(path.resolve()))}{kind}.safetensors"


def key(path: Path, sources: tuple[str, ...] = SOURCES) -> str:
    """Changes with the sample's file and with the code that prepares it. Raises OSError if there is no such file."""
    status = path.stat()
    return f"{status.st_size}-{status.st_mtime_ns}-{code_version(sources)}"


@functools.cache
def code_version(sources: tuple[str, ...] = SOURCES) -> str:
    return _digest("".join(file.read_text(encoding="utf-8") for pattern in sources
                           for file in sorted(ROOT.glob(pattern))))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]
