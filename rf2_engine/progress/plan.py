# SPDX-License-Identifier: GPL-3.0-or-later
"""The stages of one view layer, and the only place where a stage is entered."""
from __future__ import annotations

import time
from contextlib import contextmanager

from ...model import progress
from . import costs, estimate
from .stages import ENCODE, LOAD, TEXTURES, Stage, Work


class Plan:
    """The work of the stages of a view layer, and the seconds that they took."""

    def __init__(self, work: dict[Stage, Work], setup: str, layers: int = 1) -> None:
        """setup: the settings that the costs belong to (costs.py). layers: number of view layers of the frame."""
        self.seconds: dict[str, float] = {}  # so far, by the text of a stage
        self._work, self._setup = dict(work), setup
        estimate.frame.begin_layer(layers, {stage: self._expected(stage) for stage in work})

    @contextmanager
    def enter(self, stage: Stage):
        """Time the stage that works inside, show it by the bar, end it after Esc, and learn its cost."""
        units, times = self._work.get(stage, Work(0))
        with progress.part(0.0, 1.0, stage.text):
            estimate.frame.begin_stage(stage, 1 / max(times, 1))
            progress.report(0.0)
            begin = time.perf_counter()
            try:
                yield
            finally:  # a stage that was stopped took time as well
                seconds = time.perf_counter() - begin
                self.seconds[stage.text] = self.seconds.get(stage.text, 0.0) + seconds
            costs.learn(stage, units, seconds, self._setup)
            progress.report(1.0)

    def skip(self, stage: Stage) -> None:
        """Drop a stage that has nothing to do after all, and learn that it takes less than expected."""
        estimate.frame.expect(stage, 0.0)
        costs.learn(stage, self._work.pop(stage, Work(0)).units, 0.0, self._setup)

    def set_triangles(self, count: int) -> None:
        """Correct the number of triangles, which is the budget until the scene is converted."""
        for stage in {TEXTURES, ENCODE} & self._work.keys():
            self._work[stage] = self._work[stage]._replace(units=count)
            estimate.frame.expect(stage, self._expected(stage))

    def learn_memory(self, added: float, pixels: int, triangles: int) -> None:
        """Learn the MiB that a render of this size added to Blender's memory."""
        costs.learn_memory(self._setup, not self._work[LOAD].total, added, pixels, triangles)

    def _expected(self, stage: Stage) -> float:
        return costs.seconds(stage, self._work[stage].total, self._setup)
