# SPDX-License-Identifier: GPL-3.0-or-later
"""Find which distributions in a folder of packages are complete, by checking their files.

pip lists in NAME-VERSION.dist-info/RECORD every file of a distribution with its size and hash. Used in Blender and in
package_worker.py: standard library only.
"""
from __future__ import annotations

import base64
import csv
import hashlib
import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

STAGING = ".partial"  # where package_worker.py works, inside the folder


@dataclass(frozen=True)
class Entry:
    path: str    # relative to the folder, with "/"
    sha256: str  # URL-safe base64 without padding, or "" (RECORD itself)
    size: int    # bytes, or -1 (RECORD itself)


def long(folder: Path) -> Path:
    """The same folder, where Windows allows paths in it to be longer than 260 characters."""
    return Path(f"\\\\?\\{folder.absolute()}") if os.name == "nt" and not str(folder).startswith("\\\\") else folder


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def infos(folder: Path) -> dict[str, list[Path]]:
    """{distribution: its .dist-info folders}; more than one is what an interrupted replacement leaves."""
    found = {}
    for path in sorted(folder.glob("*.dist-info")):
        found.setdefault(normalised(path.name.partition("-")[0]), []).append(path)
    return found


def is_data(path: str) -> bool:
    """Whether it is in a wheel's NAME-VERSION.data: programs and manuals."""
    return path.partition("/")[0].endswith(".data")


def entries(info: Path) -> list[Entry]:
    """What RECORD lists inside the folder, without compiled Python, programs and manuals; [] when unreadable."""
    try:
        rows = list(csv.reader((info / "RECORD").read_text(encoding="utf-8").splitlines()))
        return [Entry(path, sha256.removeprefix("sha256="), int(size or -1)) for path, sha256, size in rows
                if not path.startswith(("..", "/")) and not path.endswith(".pyc") and not is_data(path)]
    except (OSError, ValueError, csv.Error):
        return []


def sizes(folder: Path) -> dict[str, int]:
    """{path relative to the folder: bytes} of all files that stay there while it looks, but for STAGING."""
    found = {}
    for path, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if name != STAGING]
        prefix = "" if path == str(folder) else os.path.relpath(path, folder).replace(os.sep, "/") + "/"
        for name in files:
            with suppress(FileNotFoundError):
                found[prefix + name] = os.stat(os.path.join(path, name)).st_size
    return found


def intact(folder: Path, by_content: bool = False) -> dict[str, str]:
    """{distribution: version} of all whose every file is there in its size, and `by_content` has its hash too."""
    folder = long(folder)
    if not folder.is_dir():
        return {}
    there, found = sizes(folder), {}
    for name, (info, *more) in infos(folder).items():
        listed = entries(info)
        if not more and _is_whole(info, listed) and all(
                entry.path in there and entry.size in (-1, there[entry.path]) for entry in listed):
            if not by_content or all(_has_hash(folder / entry.path, entry.sha256) for entry in listed):
                found[name] = info.name.removesuffix(".dist-info").partition("-")[2]
    return found


def _is_whole(info: Path, listed: list[Entry]) -> bool:
    """Not cut off: the list names its own end and something beside itself."""
    paths = {entry.path for entry in listed}
    return {f"{info.name}/METADATA", f"{info.name}/RECORD"} <= paths


def _has_hash(path: Path, sha256: str) -> bool:
    if not sha256:
        return True
    with open(path, "rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").digest()
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode() == sha256
