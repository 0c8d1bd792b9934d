# SPDX-License-Identifier: GPL-3.0-or-later
"""Show stage, time left, memory and progress bar while a frame renders, and check Esc."""
from __future__ import annotations

import threading
import time
from contextlib import contextmanager

import bpy

from ...model.errors import RenderCancelled
from ..runtime import running
from . import cycles_text, estimate, memory, status_line

REDRAW_INTERVAL = 0.1  # seconds; in background mode every status is a line of output
HOLD_INTERVAL = 0.02   # seconds between two looks at a bar that somebody else moves too
PRINT_INTERVAL = 2.0   # seconds between two lines of output about Cycles, in background mode


class Status:
    """The listener of one view layer's progress."""

    def __init__(self, engine: bpy.types.RenderEngine, layer: str = "") -> None:
        """layer: the name of the view layer, if the frame has several."""
        self.engine = engine
        self.sample = ""  # "Sample 3 of 16", or nothing
        self.views = [""]  # that Cycles renders one after the other
        self._layer = layer
        self._shown = ("", 0.0)
        self._has_line = False  # which says how much time is left
        self._at_first = memory.held()
        self._most = self._at_first[0]

    @contextmanager
    def during_cycles(self, words: str, share: float = 1.0, time_limit: float = 0.0,
                      window: bool = not bpy.app.background):
        """Inside, while Cycles runs, a line says how far it is, and the bar goes on at our pace.

        It gives the text that Cycles writes. `words` get Cycles' percentage; its run is this `share` of the
        stage; `time_limit` is its own, in seconds.
        Cycles moves the bar too, from 0 to 1, and sets Blender's text, which two threads must not do at the same time.
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
            fraction, said = 0.0, begin
            while not done.wait(HOLD_INTERVAL):
                now = time.perf_counter()
                fraction = max(fraction, self._of_views(cycles_text.fraction(text.read(), now - begin, time_limit)))
                line = _line(words, fraction, estimate.frame.remaining(share * fraction, even=True))
                if window:
                    self.engine.update_progress(estimate.frame.bar)
                    status_line.show(line)
                elif now - said > PRINT_INTERVAL:
                    said = now
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
            self._show_memory()  # Cycles' own is what it shows in the end, even when it was stopped

    def _of_views(self, fraction: float) -> float:
        """Of all views, what that fraction of the one is that Cycles renders."""
        if len(self.views) == 1:
            return fraction
        view = self.engine.active_view_get()
        return (self.views.index(view) + fraction) / len(self.views) if view in self.views else 0.0

    def __call__(self, text: str, fraction: float) -> None:
        """Raises RenderCancelled after Esc, or when the add-on is being disabled."""
        if self.esc_pressed() or running.is_stopping():
            raise RenderCancelled()
        now = time.perf_counter()
        if text != self._shown[0] or now - self._shown[1] > REDRAW_INTERVAL:
            self._shown = text, now
            left = estimate.frame.remaining(min(max(fraction, 0.0), 1.0))
            self._show_memory()
            words = ("" if self._has_line else f"Remaining {_time(left)}", self.sample, text)
            self.engine.update_stats(self._layer, " | ".join(filter(None, words)))
            self.engine.update_progress(estimate.frame.bar)

    def _show_memory(self) -> None:
        used, peak = memory.held()
        self._most = max(self._most, used)
        self.engine.update_memory_stats(memory_used=used, memory_peak=peak)

    @property
    def memory_added(self) -> float:
        """MiB that this process has held beyond what it held at first."""
        _, peak = memory.held()
        most = peak if peak > self._at_first[1] else self._most
        return max(most - self._at_first[0], 0.0)

    def esc_pressed(self) -> bool:
        return self.engine.test_break()


def _line(words: str, fraction: float, left: float) -> str:
    """Without a percentage while nothing was heard: through smoke the first samples take most of the time."""
    percent = f"{int(100 * fraction)} %" if fraction else ""
    return f"{words.format(percent).rstrip()}, {_time(left)} left"


def _time(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"
