# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders of .blend files in processes of their own, and Cycles in about the time that something else took."""
from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from .extension import ROOT

FEW, MANY = 4, 24  # samples that are measured first


def render(scene: Path, output: Path, *options: object) -> dict:
    """What `python -m tools.render` prints, with its options. Raises RuntimeError with the engine's message."""
    command = [sys.executable, "-m", "tools.render", scene.resolve(), "-o", output.resolve(), *options]
    done = subprocess.run(list(map(str, command)), cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{scene}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def samples_in_time(seconds: float, most: int, measure: Callable[[int], float]) -> tuple[int, float]:
    """The number of samples, `most` at most, that takes nearest to `seconds`, and the seconds that it took.

    measure(samples) renders so many and returns the seconds. Two counts are measured, then one on the line through
    both; the nearest of the three is the answer.
    """
    few, many = min(FEW, most), min(MANY, most)
    measured = {count: measure(count) for count in dict.fromkeys((few, many))}
    per_sample = (measured[many] - measured[few]) / max(many - few, 1)
    wanted = few + (seconds - measured[few]) / per_sample if per_sample > 0 else most
    count = round(min(max(wanted, 1), most))
    if count not in measured:
        measured[count] = measure(count)
    nearest = min(measured, key=lambda n: abs(measured[n] - seconds))
    return nearest, measured[nearest]
