# SPDX-License-Identifier: GPL-3.0-or-later
"""A clone without Git LFS has short texts where large files belong."""
from __future__ import annotations

from pathlib import Path

BEGIN = b"version https://git-lfs.github.com/spec/"


def is_pointer(path: str | Path) -> bool:
    """Whether such a text is there in place of the file. Raises OSError."""
    with open(path, "rb") as file:
        return file.read(len(BEGIN)) == BEGIN


def remedy(folder: str | Path) -> str:
    """For messages, behind the name of the file."""
    return f"stands for a file that was not downloaded: run `git lfs pull` in {folder}, or download it by itself"
