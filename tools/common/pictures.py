# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture files: written whole or not at all, and multilayer EXR files as Blender writes them."""
from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path

import numpy as np


def check_output(path: Path) -> None:
    """Make the folder of an output and try it, before the work rather than after. Raises OSError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise OSError(f"{path} cannot be written: {error.strerror}") from error
    if path.is_dir():
        raise OSError(f"{path} cannot be written: it is a folder")


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` make an EXR, PNG or WebP file under another name, read it again, and give it the name `path`.

    Blender reports success whether or not the disk had room. Raises OSError naming `path`; what was there stays then.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        with _silent_stderr():
            write(temporary)
            _verify(temporary)
        os.replace(temporary, path)
    except Exception as error:  # of three libraries, each with exceptions of its own
        reason = getattr(error, "strerror", None) or "the file came out incomplete, is the disk full?"
        raise OSError(f"{path} cannot be written: {reason}") from error
    finally:
        temporary.unlink(missing_ok=True)


def to_bytes(encoded: np.ndarray) -> np.ndarray:
    """u8 of an sRGB-encoded picture in [0, 1], any shape."""
    return (encoded * 255 + 0.5).astype(np.uint8)


def read_pass(path: Path, name: str, channels: str, layer: str | None = None) -> np.ndarray:
    """(H, W, len(channels)) f32 of a pass of a view layer (the first), row 0 on top: ("Combined", "RGB"), for example.

    Raises KeyError naming the file when there is no such pass.
    """
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels_by_name = {key: channel.pixels for key, channel in file.channels().items()}
    ending = f".{name}.{channels[0]}"
    layers = [key.removesuffix(ending) for key in channels_by_name
              if key.endswith(ending) and layer in (None, key[:-len(ending)])]
    if not layers:
        raise KeyError(f"{path} has no pass {name}")
    return np.stack([channels_by_name[f"{min(layers)}.{name}.{c}"] for c in channels], axis=-1).astype(np.float32)


def _verify(path: Path) -> None:
    """Raises what the library raises for a file that is cut short."""
    if path.suffix.lower() == ".exr":
        import OpenEXR
        with OpenEXR.File(str(path), separate_channels=True) as file:
            file.channels()  # without this, broken pixels are only a warning
        return
    from skimage.io import imread
    imread(path)


@contextmanager
def _silent_stderr():
    """Keep what C code says about the file from stderr: the exception says it."""
    stderr, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)
