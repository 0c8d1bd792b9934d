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


def allow_long_paths(folder: Path) -> Path:
    """The folder, spelled so that Windows allows paths of more than 260 characters in it."""
    return Path(f"\\\\?\\{folder.absolute()}") if os.name == "nt" and not str(folder).startswith("\\\\") else folder


def normalise(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def find_infos(folder: Path) -> dict[str, list[Path]]:
    """{distribution: its .dist-info folders}; an interrupted replacement leaves more than one."""
    infos = {}
    for path in sorted(folder.glob("*.dist-info")):
        infos.setdefault(normalise(path.name.partition("-")[0]), []).append(path)
    return infos


def is_data(path: str) -> bool:
    """Whether a path is inside NAME-VERSION.data of a wheel, which has programs and manuals."""
    return path.partition("/")[0].endswith(".data")


def read_entries(info: Path) -> list[Entry]:
    """What RECORD lists inside the folder, without compiled Python, programs and manuals; [] if unreadable."""
    try:
        rows = list(csv.reader((info / "RECORD").read_text(encoding="utf-8").splitlines()))
        return [Entry(path, sha256.removeprefix("sha256="), int(size or -1)) for path, sha256, size in rows
                if not path.startswith(("..", "/")) and not path.endswith(".pyc") and not is_data(path)]
    except (OSError, ValueError, csv.Error):
        return []


def measure_files(folder: Path) -> dict[str, int]:
    """{path relative to the folder: bytes} of all files outside STAGING, but those that vanish meanwhile."""
    sizes = {}
    for path, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if name != STAGING]
        prefix = "" if path == str(folder) else os.path.relpath(path, folder).replace(os.sep, "/") + "/"
        for name in files:
            with suppress(FileNotFoundError):
                sizes[prefix + name] = os.stat(os.path.join(path, name)).st_size
    return sizes


def find_intact(folder: Path, by_content: bool = False) -> dict[str, str]:
    """{distribution: version} of those whose files all exist in their sizes; by_content: and with their hashes."""
    folder = allow_long_paths(folder)
    if not folder.is_dir():
        return {}
    sizes, intact = measure_files(folder), {}
    for name, (info, *more) in find_infos(folder).items():
        entries = read_entries(info)
        if not more and _is_complete(info, entries) and all(
                entry.path in sizes and entry.size in (-1, sizes[entry.path]) for entry in entries):
            if not by_content or all(_has_hash(folder / entry.path, entry.sha256) for entry in entries):
                intact[name] = info.name.removesuffix(".dist-info").partition("-")[2]
    return intact


def _is_complete(info: Path, entries: list[Entry]) -> bool:
    """Whether a RECORD is not cut off: it names itself, which comes last, and the metadata."""
    paths = {entry.path for entry in entries}
    return {f"{info.name}/METADATA", f"{info.name}/RECORD"} <= paths


def _has_hash(path: Path, sha256: str) -> bool:
    if not sha256:
        return True
    with open(path, "rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").digest()
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode() == sha256
