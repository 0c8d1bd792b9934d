# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate how much of a frame is done, from the seconds that its stages took before on this machine (costs.py)."""
from __future__ import annotations

import time
from dataclasses import dataclass, field

from .stages import Stage

TRUSTED_FRACTION = 0.1  # of a steady stage: from here on its own pace counts alone
OVERTIME = 0.2          # share of the time taken that is expected to follow when a stage takes longer than expected


@dataclass
class Frame:
    """One F12 with all its view layers, which reports what begins and how far it is. There is one: `frame`."""

    begin: float = field(default_factory=time.perf_counter)
    bar: float = 0.0             # never falls
    layers_begun: int = 0
    layers_left: int = 0
    stages: dict[Stage, float] = field(default_factory=dict)    # seconds of the layer's stages
    expected: dict[Stage, float] = field(default_factory=dict)  # seconds of what has not begun of them
    stage_begin: float = 0.0
    stage_expected: float = 0.0
    steady_fraction: float = 0.0  # last reported by a steady stage
    steady_seconds: float = 0.0   # that it had taken by then
    memory_peak: float = 0.0      # MiB of this process, at most so far; the view layers' Status measures it

    def restart(self) -> None:
        """Another frame begins."""
        self.__init__()

    def begin_layer(self, layers: int, stages: dict[Stage, float]) -> None:
        """Begin one of the frame's view layers; `stages` are the expected seconds of its stages."""
        self.layers_begun += 1
        self.layers_left = max(layers - self.layers_begun, 0)
        self.stages, self.expected = dict(stages), dict(stages)

    def expect(self, stage: Stage, seconds: float) -> None:
        """Change the expected seconds of a stage that has not begun."""
        self.stages[stage] = self.expected[stage] = seconds

    def begin_stage(self, stage: Stage, share: float = 1.0) -> None:
        """Begin a share of a stage."""
        before = self.expected.get(stage, 0.0)
        self.expected[stage] = max(before - share * self.stages.get(stage, 0.0), 0.0)
        self.stage_begin, self.stage_expected = time.perf_counter(), before - self.expected[stage]
        self.steady_fraction = self.steady_seconds = 0.0

    def remaining(self, fraction: float, is_steady: bool = False) -> float:
        """Seconds until the frame is done, given the fraction of its stage: the larger, the more its own pace counts.

        is_steady: the stage works at one pace, which is soon known, but reports its fraction only now and then.
        """
        now = time.perf_counter()
        taken = now - self.stage_begin
        by_costs = max(self.stage_expected - taken, OVERTIME * taken)
        if is_steady and fraction > self.steady_fraction:
            self.steady_fraction, self.steady_seconds = fraction, taken
        total = (self.steady_seconds if is_steady else taken) / max(fraction, 1e-9)
        if is_steady:
            by_pace, trust = max(total - taken, OVERTIME * (taken - self.steady_seconds)), fraction / TRUSTED_FRACTION
        else:
            by_pace, trust = total * (1 - fraction), fraction ** 2
        trust = min(trust, 1)
        stage = (1 - trust) * by_costs + trust * by_pace
        remaining = stage + sum(self.expected.values()) + self.layers_left * sum(self.stages.values())
        elapsed = now - self.begin
        self.bar = max(self.bar, elapsed / max(elapsed + remaining, 1e-9))
        return remaining


frame = Frame()
