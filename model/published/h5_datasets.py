# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the datasets of an H5 file and check them; h5py is imported only when it is used."""
from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..errors import SceneError


class Datasets:
    """The datasets of an open h5py file; an empty one is an absent one (docs/scene-input.md 8.1).

    Every error names the file, the dataset and what to do.
    """

    def __init__(self, path: Path, file):
        self._path, self._file = path, file

    def __contains__(self, key: str) -> bool:
        return self._find(key) is not None

    def read(self, key: str, *layouts: tuple[int | str, ...], half: bool = False, finite: bool = True) -> np.ndarray:
        """A dataset as f32 in the machine's byte order; half keeps f16 as it is.

        layouts: the shapes that will do; a letter stands for any size, the same wherever it occurs in that shape.
        Raises SceneError for a dataset that is absent, damaged, not numeric, of another shape or, with finite, that
        holds NaN or infinity.
        """
        item = self._find(key)
        if item is None:
            raise self.error(key, "is empty" if key in self._file else "is missing",
                             "without it this is no RenderFormer-V2 scene, export it again")
        with self._reading(key):
            dtype, shape = item.dtype, item.shape
        if dtype.kind not in "fiu":
            raise self.error(key, f"holds no real numbers (its type is {dtype})", "store float32")
        if not any(_fits(shape, layout) for layout in layouts):
            expected = " or ".join(f"({', '.join(map(str, layout))}{',' * (len(layout) == 1)})" for layout in layouts)
            raise self.error(key, f"has shape {shape}, expected {expected}", "store it in that shape")
        with self._reading(key), np.errstate(over="ignore"):
            array = item[()].astype(np.float16 if half and np.can_cast(dtype, np.float16) else np.float32)
        if finite and not np.isfinite(array).all():
            at = np.argwhere(~np.isfinite(array))
            raise self.error(key, f"is not finite ({len(at)} of {array.size} values, the first at {at[0].tolist()})",
                             f"store numbers that {array.dtype} can hold, or export the scene again")
        return array

    def metadata(self, key: str) -> dict:
        """A root attribute of JSON text; {} where there is none. Raises SceneError for anything but a JSON object."""
        try:
            with self._reading(key):
                text = self._file.attrs.get(key, "{}")
            content = json.loads(text)
        except (TypeError, ValueError) as error:
            raise self.error(key, f"is not JSON text ({error})", "correct the attribute or remove it") from error
        if not isinstance(content, dict):
            raise self.error(key, f"is JSON, but not an object: {text!r}", "correct the attribute or remove it")
        return content

    def error(self, key: str, what: str, advice: str) -> SceneError:
        return SceneError(f"{self._path}: {key} {what}: {advice}")

    def _find(self, key: str):
        with self._reading(key):
            item = self._file.get(key)
            return item if getattr(item, "size", None) else None  # groups have no size, h5py.Empty has None

    @contextmanager
    def _reading(self, key: str):
        try:
            yield
        except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:  # h5py raises all of these
            raise self.error(key, f"cannot be read ({error})",
                             "the file is damaged, copy or export it again") from error


def _fits(shape: tuple[int, ...], layout: tuple[int | str, ...]) -> bool:
    sizes: dict[str, int] = {}
    return len(shape) == len(layout) and all(
        size == (sizes.setdefault(expected, size) if isinstance(expected, str) else expected)
        for size, expected in zip(shape, layout))


@contextmanager
def open_datasets(path: Path):
    """The Datasets of a file. Raises SceneError for one that is not there or no H5 file, and without h5py."""
    if not path.is_file():
        raise SceneError(f"{path}: there is no such file")
    try:
        file = load_h5py().File(path, "r")
    except OSError as error:
        raise SceneError(f"{path} is damaged or not an H5 file ({error})") from error
    with file:
        yield Datasets(path, file)


def load_h5py():
    try:
        import h5py
    except ImportError as error:
        raise SceneError(f"h5py is needed to read and write H5 scenes: run {sys.executable} -m pip install h5py, and "
                         "start again") from error
    return h5py
