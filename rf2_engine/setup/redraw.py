# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep our panels up to date while something is downloaded or installed.

This uses a timer, because a modal operator would block Blender's autosave, and end with every Esc.
"""
from __future__ import annotations

import bpy

from . import package_install, packages, weights_download

INTERVAL = 0.25  # seconds


def redraw() -> float | None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("PREFERENCES", "PROPERTIES"):
                area.tag_redraw()
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
