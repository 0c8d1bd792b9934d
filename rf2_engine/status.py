# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user sees while a frame renders: stage, time left, memory, progress bar; and what stops it: Esc."""
from __future__ import annotations

import threading
import time
from contextlib import contextmanager

import bpy

from ..model import progress
from ..model.errors import RenderCancelled
from . import estimate, memory, running

REDRAW_INTERVAL = 0.1  # seconds; in background mode every status is a line of output
HOLD_INTERVAL = 0.02   # seconds between two looks at a bar that somebody else moves too


class Status:
    """The listener of one view layer's progress, and the seconds of its stages."""

    def __init__(self, engine: bpy.types.RenderEngine) -> None:
        self.engine = engine
        self.seconds: dict[str, float] = {}
        self.sample = ""  # "Sample 3 of 16", or nothing
        self._layer = ""
        self._work: dict[str, float] = {}
        self._shown = ("", 0.0)

    def expect(self, layer: str, layers: int, work: dict[str, float]) -> None:
        """Say what this view layer's stages have to do, by the keys of `stage`, and how many layers the frame has."""
        self._work = work
        self._layer = layer if layers > 1 else ""
        estimate.frame.begin_layer(layers, work)

    @contextmanager
    def stage(self, name: str, part: str = "", share: float = 1.0):
        """Time what runs inside under `name`; a stage in several parts has a key for each, "name, part".

        One that is entered several times says what share of its work is done each time.
        """
        key = f"{name}, {part}" if part else name
        with progress.part(0.0, 1.0, name):
            estimate.frame.begin_stage(key, share)
            progress.report(0.0)
            begin = time.perf_counter()
            yield
            took = time.perf_counter() - begin
            self.seconds[name] = self.seconds.get(name, 0.0) + took
            estimate.learn(key, share * self._work.get(key, 0.0), took)
            progress.report(1.0)

    def skip(self, key: str, share: float) -> None:
        """This share of a stage need not be done."""
        estimate.frame.begin_stage(key, share)

    @contextmanager
    def holding_the_bar(self, window: bool = not bpy.app.background):
        """Inside, the bar goes on at our pace although Cycles, whose session moves it too, starts again from 0.

        Only the bar: its text is Cycles' own meanwhile, for two threads must not set it at the same time.
        """
        done = threading.Event()

        def hold() -> None:
            while not done.wait(HOLD_INTERVAL):
                estimate.frame.remaining(0.0)
                self.engine.update_progress(estimate.frame.bar)

        holder = threading.Thread(target=hold, daemon=True)
        if window:  # otherwise there is no bar
            holder.start()
        try:
            yield
        finally:
            done.set()
            if holder.is_alive():
                holder.join()

    def __call__(self, text: str, fraction: float) -> None:
        """Raises RenderCancelled after Esc, or when the add-on is being disabled."""
        if self.esc_pressed() or running.is_stopping():
            raise RenderCancelled()
        now = time.perf_counter()
        if text != self._shown[0] or now - self._shown[1] > REDRAW_INTERVAL:
            self._shown = text, now
            left = round(estimate.frame.remaining(min(max(fraction, 0.0), 1.0)))
            used, peak = memory.held()
            self.engine.update_memory_stats(memory_used=used, memory_peak=peak)
            words = (f"Remaining {left // 60}:{left % 60:02}", self.sample, text)
            self.engine.update_stats(self._layer, " | ".join(filter(None, words)))
            self.engine.update_progress(estimate.frame.bar)

    def esc_pressed(self) -> bool:
        return self.engine.test_break()
