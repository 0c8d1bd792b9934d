# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw sizes, long texts and progress in our panels, and draw the panels again when something has changed."""
from __future__ import annotations

import shutil
import textwrap
from pathlib import Path

import blf
import bpy

from . import package_install, packages, weights_download
from .worker_process import WorkerProcess

MARGIN = 70        # of a panel and an icon; pixels at Blender's usual size
TABS = 22          # of a sidebar
CHARACTERS = 70    # of a line where no region is drawn
INTERVAL = 0.25  # seconds


def draw_text(layout, text: str, icon: str = "ERROR") -> None:
    """Draw a text in as many lines as it needs in the region that is being drawn."""
    region, preferences = bpy.context.region, bpy.context.preferences
    scale = preferences.system.ui_scale
    blf.size(0, preferences.ui_styles[0].widget.points * scale)
    margin = MARGIN + TABS * (region is not None and region.type == "UI")
    lines = textwrap.wrap(text, CHARACTERS) if region is None else wrap(text, region.width - margin * scale)
    column = layout.column(align=True)
    for number, line in enumerate(lines):
        column.label(text=line, icon="BLANK1" if number else icon)


def draw_steps(layout, steps: list[tuple[str, str]]) -> None:
    """Draw steps (text, address or ""), with buttons to their web pages."""
    for number, (text, page) in enumerate(steps, 1):
        draw_text(layout, f"{number}. {text}", icon="BLANK1")
        if page:
            layout.operator("wm.url_open", text=page.partition("://")[2], icon="URL").url = page


def wrap(text: str, width: float) -> list[str]:
    """Lines of at most this width, in pixels at blf's size; wider words are broken."""
    def fits(line: str) -> bool:
        return len(line) < 2 or blf.dimensions(0, line)[0] <= width

    lines: list[str] = []
    for word in text.split():
        if lines and fits(f"{lines[-1]} {word}"):
            lines[-1] += f" {word}"
            continue
        while not fits(word):
            end = next(n for n in range(len(word) - 1, 0, -1) if fits(word[:n]))
            lines.append(word[:end])
            word = word[end:]
        lines.append(word)
    return lines


def draw_progress(layout, process: WorkerProcess, text: str) -> None:
    """Draw a bar with the progress of a process, and for how long no data have come."""
    silent = process.silent_seconds
    layout.progress(factor=process.present / max(process.total, 1),
                    text=text if silent < 5 else f"{text} (no data for {silent:.0f} s)")


def format_size(size: int) -> str:
    """Bytes as "1.75 GB" or "210.3 MB"."""
    return f"{size / 1e9:.2f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def free_space(folder: Path) -> int:
    """Free bytes on the disk where the folder is or will be."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free


def redraw_areas(*kinds: str) -> None:
    """Have all editors of these types drawn again, in all windows."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in kinds:
                area.tag_redraw()


def redraw() -> float | None:
    """A timer."""
    redraw_areas("PREFERENCES", "PROPERTIES")
    if package_install.current.is_running or weights_download.current.is_running:
        return INTERVAL
    packages.refresh()
    return None


def keep_redrawing() -> None:
    """Until it ends, also when another file is opened."""
    if not bpy.app.timers.is_registered(redraw):
        bpy.app.timers.register(redraw, persistent=True)


def unregister() -> None:
    if bpy.app.timers.is_registered(redraw):
        bpy.app.timers.unregister(redraw)
