# SPDX-License-Identifier: GPL-3.0-or-later
"""How sizes, long texts and progress look in our panels."""
from __future__ import annotations

import shutil
import textwrap
from pathlib import Path

import blf
import bpy

from .worker_process import WorkerProcess

MARGIN = 70        # of a panel and an icon; pixels at Blender's usual size
CHARACTERS = 70    # of a line where no region is drawn


def draw_text(layout, text: str, icon: str = "ERROR") -> None:
    """In as many lines as it needs in the region that is being drawn."""
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, _characters(text))):
        column.label(text=line, icon="BLANK1" if number else icon)


def _characters(text: str) -> int:
    """How many of the text's characters fit into a line."""
    region, preferences = bpy.context.region, bpy.context.preferences
    if region is None or not text:
        return CHARACTERS
    scale = preferences.system.ui_scale
    blf.size(0, preferences.ui_styles[0].widget.points * scale)
    width = blf.dimensions(0, text)[0] / len(text)
    return max(int((region.width - MARGIN * scale) / max(width, 1.0)), 10)


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
