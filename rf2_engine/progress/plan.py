# SPDX-License-Identifier: GPL-3.0-or-later
"""The stages of one view layer, and the only place where a stage is entered."""
from __future__ import annotations

import time
from contextlib import contextmanager

from ...model import progress
from . import costs, estimate
from .stages import ENCODE, LOAD, TEXTURES, Stage, Work


class Plan:
    """What each stage of a view layer has to do, and the seconds that it took."""

    def __init__(self, work: dict[Stage, Work], setup: str, layers: int = 1) -> None:
        """setup: what the costs belong to (costs.py). layers: how many view layers the frame has."""
        self.seconds: dict[str, float] = {}  # so far, by the text of the stages
        self._work, self._setup = dict(work), setup
        estimate.frame.begin_layer(layers, {stage: self._expected(stage) for stage in work})

    @contextmanager
    def enter(self, stage: Stage):
        """Inside, the stage does its work: timed, shown with the bar, cancelled by Esc, its cost remembered."""
        units, times = self._work.get(stage, Work(0))
        with progress.part(0.0, 1.0, stage.text):
            estimate.frame.begin_stage(stage, 1 / max(times, 1))
            progress.report(0.0)
            begin = time.perf_counter()
            try:
                yield
            finally:  # what was stopped took time, too
                took = time.perf_counter() - begin
                self.seconds[stage.text] = self.seconds.get(stage.text, 0.0) + took
            costs.learn(stage, units, took, self._setup)
            progress.report(1.0)

    def skip(self, stage: Stage) -> None:
        """There is nothing for it to do after all, and next time probably less than was thought."""
        estimate.frame.expect(stage, 0.0)
        costs.learn(stage, self._work.pop(stage, Work(0)).units, 0.0, self._setup)

    def has_triangles(self, count: int) -> None:
        """So many are in the scene; before it was converted its budget was all that was known."""
        for stage in {TEXTURES, ENCODE} & self._work.keys():
            self._work[stage] = self._work[stage]._replace(units=count)
            estimate.frame.expect(stage, self._expected(stage))

    def learn_memory(self, added: float, pixels: int, triangles: int) -> None:
        """Remember that a render of that size made Blender hold `added` MiB more."""
        costs.learn_memory(self._setup, not self._work[LOAD].total, added, pixels, triangles)

    def _expected(self, stage: Stage) -> float:
        return costs.seconds(stage, self._work[stage].total, self._setup)
