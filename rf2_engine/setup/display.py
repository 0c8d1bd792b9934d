# SPDX-License-Identifier: GPL-3.0-or-later
"""How sizes, long texts and progress look in our panels."""
from __future__ import annotations

import shutil
import textwrap
from pathlib import Path

from .worker_process import WorkerProcess


def draw_text(layout, text: str, icon: str = "ERROR") -> None:
    """In as many lines as it needs."""
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, 70)):
        column.label(text=line, icon="BLANK1" if number else icon)


def draw_progress(layout, process: WorkerProcess, text: str) -> None:
    silent = process.silent_seconds
    layout.progress(factor=process.present / max(process.total, 1),
                    text=text if silent < 5 else f"{text} (no data for {silent:.0f} s)")


def amount(size: int) -> str:
    """Bytes as "1.75 GB" or "210.3 MB"."""
    return f"{size / 1e9:.2f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def free_space(folder: Path) -> int:
    """Bytes on the disk where the folder is or will be."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free
