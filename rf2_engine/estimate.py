# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of a frame is done, judged by what its stages cost when they last ran on this machine."""
from __future__ import annotations

import time
from dataclasses import dataclass, field

# Seconds for a unit of a stage's work, by the stage's key: at first of a processor with two cores, later as measured.
_seconds_per_unit = {
    "Converting the scene": 1.0,        # the scene
    "First hits": 2.5e-6,               # a sample of a pixel
    "Loading the network": 3.0,         # once
    "Network, scene": 3e-4,             # a triangle of the budget
    "Network, view": 2e-5,              # a pixel
    "Cycles Reference": 4e-6,           # a sample of a pixel
}
LEAST_LEARNED = 0.5   # of what was known: a stage that found its work done already says little about the next time
OVERTIME = 0.2        # of a stage's time, expected to follow when it takes longer than it should


def seconds(key: str, work: float) -> float:
    """What so many units of a stage's work are expected to take."""
    return _seconds_per_unit.get(key, 0.0) * work


def learn(key: str, work: float, took: float) -> None:
    """Remember that so many units of a stage's work took so many seconds."""
    if work:
        _seconds_per_unit[key] = max(took / work, LEAST_LEARNED * _seconds_per_unit.get(key, 0.0))


@dataclass
class Frame:
    """One F12 with all its view layers: feed it with what begins and how far that is."""

    begin: float = field(default_factory=time.perf_counter)
    bar: float = 0.0             # never falls
    layers_begun: int = 0
    layers_left: int = 0
    stages: dict[str, float] = field(default_factory=dict)    # seconds of the layer's stages, by key
    expected: dict[str, float] = field(default_factory=dict)  # of what of them has not begun
    stage_begin: float = 0.0
    stage_expected: float = 0.0

    def begin_layer(self, layers: int, work: dict[str, float]) -> None:
        """`work` is what the stages of this view layer have to do, by key; the frame has so many layers."""
        self.layers_begun += 1
        self.layers_left = max(layers - self.layers_begun, 0)
        self.stages = {key: seconds(key, units) for key, units in work.items()}
        self.expected = dict(self.stages)

    def begin_stage(self, key: str, share: float = 1.0) -> None:
        """This share of a stage begins."""
        before = self.expected.get(key, 0.0)
        self.expected[key] = max(before - share * self.stages.get(key, 0.0), 0.0)
        self.stage_begin, self.stage_expected = time.perf_counter(), before - self.expected[key]

    def remaining(self, fraction: float) -> float:
        """Seconds until the frame is done when its stage has come so far: the further, the more its own pace counts."""
        now = time.perf_counter()
        took = now - self.stage_begin
        as_known = max(self.stage_expected - took, OVERTIME * took)
        stage = (1 - fraction ** 2) * as_known + fraction * (1 - fraction) * took
        left = stage + sum(self.expected.values()) + self.layers_left * sum(self.stages.values())
        elapsed = now - self.begin
        self.bar = max(self.bar, elapsed / max(elapsed + left, 1e-9))
        return left


frame = Frame()


def begin_frame() -> None:
    global frame
    frame = Frame()
