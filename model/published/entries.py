# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a JSON file that others wrote, each with its place in the file, for errors that name it."""
from __future__ import annotations

import json
import sys
from pathlib import Path, PurePosixPath, PureWindowsPath

from ..errors import SceneError


def read_json_file(file: Path, kind: type[Entry]) -> Entry:
    """The whole file as a `kind`. Raises SceneError naming it, FileNotFoundError where there is none."""
    try:
        return kind(json.loads(Path(file).read_text(encoding="utf-8-sig")), str(file))
    except FileNotFoundError:
        raise
    except (OSError, ValueError, RecursionError) as error:
        raise SceneError(f"{file} cannot be read ({error}): copy or export it again") from error


class Entry:
    """One value of the file, and where it stands there."""

    def __init__(self, value, where: str):
        self.value, self.where = value, where

    def __getitem__(self, key: str) -> Entry:
        return type(self)(self.mapping().get(key), f"{self.where}: {key}")

    def mapping(self) -> dict:
        if not isinstance(self.value, dict):
            raise self.wrong("an object in braces")
        return self.value

    def named(self) -> list[tuple[str, Entry]]:
        """The entries of an object by their keys."""
        return [(key, self[key]) for key in self.mapping()]

    def items(self) -> list[Entry]:
        if not isinstance(self.value, list):
            raise self.wrong("a list")
        return [type(self)(value, f"{self.where}, item {i}") for i, value in enumerate(self.value)]

    def text(self, default: str | None = None) -> str:
        if self.value is None and default is not None:
            return default
        if not isinstance(self.value, str):
            raise self.wrong("a text")
        return self.value

    def path(self) -> str:
        """A place below the frame: nothing else of the disk is read."""
        text = self.text()
        parts = PureWindowsPath(text).parts
        if not parts or PureWindowsPath(text).is_absolute() or PurePosixPath(text).is_absolute() or ".." in parts:
            raise self.wrong("a path inside the frame's folder")
        return "/".join(parts)

    def flag(self, default: bool = False) -> bool:
        if self.value is None:
            return default
        if not isinstance(self.value, bool):
            raise self.wrong("true or false")
        return self.value

    def numbers(self, count: int, default: float | None = None):
        """A number, or a list of `count` of them."""
        if self.value is None and default is not None:
            return default
        values = self.value if count > 1 else [self.value]
        if not isinstance(values, list) or len(values) != count or not all(map(_is_number, values)):
            raise self.wrong("a number" if count == 1 else f"{count} numbers")
        numbers = [float(value) for value in values]
        return numbers if count > 1 else numbers[0]

    def wrong(self, expected: str) -> SceneError:
        actual = "nothing" if self.value is None else json.dumps(self.value)[:60]
        return SceneError(f"{self.where}: expected {expected}, found {actual}")


def _is_number(value) -> bool:
    """Whether it is one that a float can hold."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
