# SPDX-License-Identifier: GPL-3.0-or-later
"""The H5 files that a command names: one, those of a folder, or those of a list."""
from __future__ import annotations

import re
from pathlib import Path

from renderformer_v2.model.published.h5_datasets import open_datasets
from tools.common.tone_mapping import TONE_MAPPERS

SUFFIXES = (".h5", ".hdf5")


def list_inputs(path: Path) -> list[tuple[Path, str | None]]:
    """Files in order, each with the tone mapper that a list names for it.

    A folder's files are in natural order ("2" before "10"). A list is a text file with a path a line, relative to the
    list, and perhaps a tone mapper after it; empty lines and those that begin with # are left out. Raises ValueError
    for none at all and for two that would have pictures of the same name, SceneError for one that is no H5 file.
    """
    if path.is_dir():
        found = [(file, None) for file in sorted(path.iterdir(), key=_natural_key) if file.suffix.lower() in SUFFIXES]
    elif path.suffix.lower() in SUFFIXES:
        found = [(path, None)]
    else:
        found = [_parse(line, path.parent) for line in path.read_text(encoding="utf-8").splitlines()
                 if line.strip() and not line.lstrip().startswith("#")]
    if not found:
        raise ValueError(f"{path} names no H5 scene")
    names: dict[str, Path] = {}
    for file, _ in found:
        same = names.setdefault(file.stem.casefold(), file)
        if same is not file:
            raise ValueError(f"{same} and {file} would have pictures of the same name: rename one of them")
        with open_datasets(file):  # before the work rather than after
            pass
    return found


def _natural_key(file: Path) -> list[int | str]:
    return [int(word) if word.isdecimal() else word for word in re.split(r"(\d+)", file.name)]


def _parse(line: str, folder: Path) -> tuple[Path, str | None]:
    path, _, last = line.strip().rpartition(" ")
    return (folder / path.strip(), last) if last in TONE_MAPPERS else (folder / line.strip(), None)
