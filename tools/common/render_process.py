# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders of .blend files in processes of their own, and Cycles in about the time that something else took."""
from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from ..extension import ROOT

FEW = 4  # samples that are measured first


def render(scene: Path, output: Path, *options: object) -> dict:
    """What `python -m tools.render` prints, with its options. Raises RuntimeError with the engine's message."""
    command = [sys.executable, "-m", "tools.render", scene.resolve(), "-o", output.resolve(), *options]
    done = subprocess.run(list(map(str, command)), cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{scene}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def render_once(scene: Path, output: Path, *options: object) -> dict:
    """The same, which is written beside `output`; both are kept while scene, options and Blender are what they were."""
    note = output.with_suffix(".json")
    made_of = {"scene": hashlib.sha256(scene.read_bytes()).hexdigest(), "options": list(map(str, options)),
               "bpy": version("bpy")}
    known = json.loads(note.read_text()) if note.exists() and output.exists() else {}
    if known.get("made_of") != made_of:
        known = {"made_of": made_of, "printed": render(scene, output, *options)}
        note.write_text(json.dumps(known))
    return known["printed"]


def samples_in_time(seconds: float, most: int, measure: Callable[[int], float]) -> tuple[int, float]:
    """The number of samples, `most` at most, that takes nearest to `seconds`, and the seconds that it took.

    measure(samples) renders so many and returns the seconds. FEW are measured, then as many as would fit if the time
    were in proportion, then as many as fit on the line through both; the nearest of the three is the answer.
    """
    few = min(FEW, most)
    measured = {few: measure(few)}

    def try_nearest(wanted: float) -> int:
        count = round(min(max(wanted, 1), most))
        if count not in measured:
            measured[count] = measure(count)
        return count

    other = try_nearest(few * seconds / measured[few])
    if other != few:
        per_sample = (measured[other] - measured[few]) / (other - few)
        try_nearest(few + (seconds - measured[few]) / per_sample if per_sample > 0 else most)
    nearest = min(measured, key=lambda count: abs(measured[count] - seconds))
    return nearest, measured[nearest]
