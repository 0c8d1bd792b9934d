# SPDX-License-Identifier: GPL-3.0-or-later
"""Show stage, remaining time, memory and progress bar while a frame renders, and check Esc."""
from __future__ import annotations

import threading
import time
from contextlib import contextmanager

import bpy

from ...model.errors import RenderCancelled
from ..runtime import running
from . import cycles_text, estimate, memory
from .status_line import status_line

REDRAW_INTERVAL = 0.1  # seconds; in background mode every status is a line of output
HOLD_INTERVAL = 0.02   # seconds between two updates of a bar that Cycles moves as well
MEASURE_INTERVAL = 0.02  # seconds between two looks at the memory, which wait for the system
PRINT_INTERVAL = 2.0   # seconds between two lines of output about Cycles, in background mode


class Status:
    """The listener of one view layer's progress."""

    def __init__(self, engine: bpy.types.RenderEngine, layer: str = "") -> None:
        """layer: name of the view layer, if the frame has several."""
        self.engine = engine
        self.sample = ""  # "Sample 3 of 16", or empty
        self.views = [""]  # of stereoscopy, which Cycles renders one after the other
        self._layer = layer
        self._displayed = ("", 0.0)  # text, and when
        self._has_line = False  # the status line says how much time remains
        self._memory_before = memory.measure()
        self._peak = self._memory_before[0]  # MiB, since this view layer began
        self._measured = 0.0

    @contextmanager
    def during_cycles(self, words: str, share: float = 1.0, time_limit: float = 0.0,
                      window: bool = not bpy.app.background):
        """While Cycles runs inside, a line says how far it is, and the bar goes on as ours.

        Yields the text that Cycles writes. `words` is formatted with Cycles' percentage; its run is this `share` of the
        stage; `time_limit` is that of Cycles, in seconds.
        Cycles moves the bar as well, from 0 to 1, and sets Blender's text, which two threads must not do at once.
        """
        done, begin = threading.Event(), time.perf_counter()
        first = _line(words, 0.0, estimate.frame.remaining(0.0))
        self.engine.update_stats("", first)
        text = cycles_text.EngineText(self.engine, first)
        if len(self.views) > 1:
            self.engine.active_view_set(self.views[0])
        self._has_line = window
        if window:
            status_line.show(first)

        def follow() -> None:
            fraction, last_printed = 0.0, begin
            while not done.wait(HOLD_INTERVAL):
                now = time.perf_counter()
                self._measure_memory()
                fraction = max(fraction, self._across_views(cycles_text.fraction(text.read(), now - begin, time_limit)))
                line = _line(words, fraction, estimate.frame.remaining(share * fraction, is_steady=True))
                if window:
                    self.engine.update_progress(estimate.frame.bar)
                    status_line.show(line)
                elif now - last_printed > PRINT_INTERVAL:
                    last_printed = now
                    print(f"RenderFormer-V2: {line}", flush=True)

        follower = threading.Thread(target=follow, daemon=True)
        follower.start()
        try:
            yield text
        finally:
            done.set()
            follower.join()
            self._has_line = False
            status_line.show("")
            self._show_memory(self._measure_memory())  # Cycles leaves its own

    def _across_views(self, fraction: float) -> float:
        """The fraction of all views that is done, given that of the one that Cycles renders."""
        if len(self.views) == 1:
            return fraction
        view = self.engine.active_view_get()
        return (self.views.index(view) + fraction) / len(self.views) if view in self.views else 0.0

    def __call__(self, text: str, fraction: float) -> None:
        """Display a stage and its fraction. Raises RenderCancelled after Esc, or when the add-on is being disabled."""
        if self.esc_pressed() or running.is_stopping():
            raise RenderCancelled()
        now = time.perf_counter()
        is_due = text != self._displayed[0] or now - self._displayed[1] > REDRAW_INTERVAL
        if is_due or now - self._measured > MEASURE_INTERVAL:
            used, self._measured = self._measure_memory(), now
        if is_due:
            self._displayed = text, now
            remaining = estimate.frame.remaining(min(max(fraction, 0.0), 1.0))
            self._show_memory(used)
            parts = ("" if self._has_line else f"Remaining {_time(remaining)}", self.sample, text)
            self.engine.update_stats(self._layer, " | ".join(filter(None, parts)))
            self.engine.update_progress(estimate.frame.bar)

    def _measure_memory(self) -> float:
        """MiB in use. The peak of the whole process is this view layer's if it has risen since that began; what lies
        below is noticed only here, so this is called often."""
        used, peak = memory.measure()
        self._peak = max(self._peak, peak if peak > self._memory_before[1] else used)
        return used

    def _show_memory(self, used: float) -> None:
        frame = estimate.frame
        frame.memory_peak = max(frame.memory_peak, self._peak)
        self.engine.update_memory_stats(memory_used=used, memory_peak=frame.memory_peak)

    @property
    def memory_added(self) -> float:
        """MiB that this process has used at most beyond what it used at first."""
        self._measure_memory()
        return self._peak - self._memory_before[0]

    def esc_pressed(self) -> bool:
        return self.engine.test_break()


def _line(words: str, fraction: float, remaining: float) -> str:
    """No percentage before the first report of Cycles: in smoke the first samples take most of the time."""
    percent = f"{int(100 * fraction)} %" if fraction else ""
    return f"{words.format(percent).rstrip()}, {_time(remaining)} left"


def _time(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"
