# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate how much of a frame is done, by the time that its stages took before on this machine (costs.py)."""
from __future__ import annotations

import time
from dataclasses import dataclass, field

from .stages import Stage

EVEN_AFTER = 0.1      # of a stage that works at one pace: what was known before counts no more
OVERTIME = 0.2        # of a stage's time, expected to follow when it takes longer than it should


@dataclass
class Frame:
    """One F12 with all its view layers: feed it with what begins and how far that is."""

    begin: float = field(default_factory=time.perf_counter)
    bar: float = 0.0             # never falls
    layers_begun: int = 0
    layers_left: int = 0
    stages: dict[Stage, float] = field(default_factory=dict)    # seconds of the layer's stages
    expected: dict[Stage, float] = field(default_factory=dict)  # of what of them has not begun
    stage_begin: float = 0.0
    stage_expected: float = 0.0
    even_fraction: float = 0.0   # of a stage at one pace, when it was last heard of
    even_took: float = 0.0       # seconds until then

    def begin_layer(self, layers: int, stages: dict[Stage, float]) -> None:
        """`stages` are the seconds that are expected of each in this view layer; the frame has so many layers."""
        self.layers_begun += 1
        self.layers_left = max(layers - self.layers_begun, 0)
        self.stages, self.expected = dict(stages), dict(stages)

    def expect(self, stage: Stage, seconds: float) -> None:
        """Of a stage that has not begun something else is expected now."""
        self.stages[stage] = self.expected[stage] = seconds

    def begin_stage(self, stage: Stage, share: float = 1.0) -> None:
        """This share of a stage begins."""
        before = self.expected.get(stage, 0.0)
        self.expected[stage] = max(before - share * self.stages.get(stage, 0.0), 0.0)
        self.stage_begin, self.stage_expected = time.perf_counter(), before - self.expected[stage]
        self.even_fraction = self.even_took = 0.0

    def remaining(self, fraction: float, even: bool = False) -> float:
        """Seconds until the frame is done when its stage has come so far: the further, the more its own pace counts.

        `even`: the stage works at one pace, so that it is known early, but says only now and then how far it is.
        """
        now = time.perf_counter()
        took = now - self.stage_begin
        as_known = max(self.stage_expected - took, OVERTIME * took)
        if even and fraction > self.even_fraction:
            self.even_fraction, self.even_took = fraction, took
        pace = (self.even_took if even else took) / max(fraction, 1e-9)
        by_pace = max(pace - took, OVERTIME * (took - self.even_took)) if even else pace * (1 - fraction)
        trust = min(fraction / EVEN_AFTER, 1) if even else fraction ** 2
        stage = (1 - trust) * as_known + trust * by_pace
        left = stage + sum(self.expected.values()) + self.layers_left * sum(self.stages.values())
        elapsed = now - self.begin
        self.bar = max(self.bar, elapsed / max(elapsed + left, 1e-9))
        return left


frame = Frame()


def begin_frame() -> None:
    global frame
    frame = Frame()
