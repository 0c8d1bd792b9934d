# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user sees while a frame renders: stage, progress bar; and what stops it: Esc."""
from __future__ import annotations

import time
from contextlib import contextmanager

import bpy

from ..model import progress
from ..model.errors import RenderCancelled
from . import running

REDRAW_INTERVAL = 0.1  # seconds; in background mode every status is a line of output


class Status:
    """The listener of one frame's progress, and the seconds of its stages."""

    def __init__(self, engine: bpy.types.RenderEngine) -> None:
        self.engine = engine
        self.seconds: dict[str, float] = {}
        self._shown = ("", 0.0)

    @contextmanager
    def stage(self, name: str, start: float, end: float):
        """Time what runs inside under `name`; its progress goes from `start` to `end` of the bar."""
        with progress.part(start, end, name):
            progress.report(0.0)
            begin = time.perf_counter()
            yield
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin
            progress.report(1.0)

    def __call__(self, text: str, fraction: float) -> None:
        """Raises RenderCancelled after Esc, or when the add-on is being disabled."""
        if self.esc_pressed() or running.is_stopping():
            raise RenderCancelled()
        now = time.perf_counter()
        if text != self._shown[0] or now - self._shown[1] > REDRAW_INTERVAL:
            self._shown = text, now
            self.engine.update_stats("", text)
            self.engine.update_progress(min(max(fraction, 0.0), 1.0))

    def esc_pressed(self) -> bool:
        return self.engine.test_break()
