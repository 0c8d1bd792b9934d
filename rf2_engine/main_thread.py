# SPDX-License-Identifier: GPL-3.0-or-later
"""Run work on Blender's main thread, requested by a render, which has a thread of its own in the window."""
from __future__ import annotations

import threading
from collections.abc import Callable

import bpy

from ..model import progress

INTERVAL = 0.05  # seconds between two checks of the Esc key


def call(action: Callable[[], None]) -> None:
    """Wait until the main thread has done it; what it raises comes out here. RenderCancelled ends the waiting."""
    if threading.current_thread() is threading.main_thread():
        action()
        return
    done, errors = threading.Event(), []

    def act() -> None:
        try:
            action()
        except Exception as error:
            errors.append(error)
        finally:
            done.set()

    bpy.app.timers.register(act, persistent=True)
    try:
        while not done.wait(INTERVAL):
            progress.report()
    finally:
        if not done.is_set() and bpy.app.timers.is_registered(act):
            bpy.app.timers.unregister(act)
    if errors:
        raise errors[0]
