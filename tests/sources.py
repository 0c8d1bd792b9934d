# SPDX-License-Identifier: GPL-3.0-or-later
"""The repository's own files, for tests that read them; all paths are relative to ROOT."""
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("docs", "examples", "model", "rf2_engine", "tests", "tools")


def python_files() -> list[Path]:
    return _files("*.py")


def documents() -> list[Path]:
    return _files("*.md")


def _files(pattern: str) -> list[Path]:
    found = [*ROOT.glob(pattern), *(path for folder in FOLDERS for path in (ROOT / folder).rglob(pattern))]
    return sorted(path.relative_to(ROOT) for path in found)
