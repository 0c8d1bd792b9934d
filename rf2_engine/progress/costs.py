# SPDX-License-Identifier: GPL-3.0-or-later
"""Remember the seconds that the stages of a render took on this machine, between sessions of Blender.

They belong to a setup: the settings that, apart from the amount of work, decide how long a stage takes.
"""
from __future__ import annotations

import json
import os
from functools import partial
from pathlib import Path

from bpy.app.handlers import persistent

from ..registering import handlers
from ..setup import extension
from .stages import Stage, Work

LEAST_LEARNED = 0.5   # least factor on a known cost: a stage whose work was done already tells little about the next
MOST_SETUPS = 20      # the latest are remembered

# What renders add to Blender's memory, as measured (docs/measured.md 7).
FIXED, FIXED_LOADED = 850.0, 320.0         # MiB, with the network to be loaded, and with it there
LARGE = 1920 * 1080                        # pixels; beyond, more of the work is done in pieces
PIXEL, PIXEL_BEYOND = 2200, 700            # bytes
TRIANGLE, PUBLISHED_TRIANGLE = 16384, 40960  # bytes, of the network's input

_measured: dict[str, dict[str, float]] = {}  # seconds for a unit, by setup and key
_memory: dict[str, list[float]] = {}         # MiB that a render added, its pixels and its triangles, by setup


def seconds(stage: Stage, units: float, setup: str = "") -> float:
    """Expected seconds of a stage's work of that many units: as in this setup, or else as in any."""
    measured = _measured.get(setup, {})
    if stage.key in measured:
        return measured[stage.key] * units
    others = [costs[stage.key] for costs in _measured.values() if stage.key in costs]
    return (others[-1] if others else stage.first_guess) * units


def measured_seconds(work: dict[Stage, Work], setup: str) -> float | None:
    """Expected seconds of all these stages; None unless all were measured in this setup on this machine."""
    if any(stage_work.total and stage.key not in _measured.get(setup, {}) for stage, stage_work in work.items()):
        return None
    return sum(seconds(stage, stage_work.total, setup) for stage, stage_work in work.items())


def learn(stage: Stage, units: float, taken: float, setup: str = "") -> None:
    """Remember the seconds taken by a stage's work of that many units."""
    if units:
        costs = _latest(_measured, setup, {})
        costs[stage.key] = max(taken / units, LEAST_LEARNED * costs.get(stage.key, 0.0))


def learn_memory(setup: str, loaded: bool, added: float, pixels: int, triangles: int) -> None:
    """Remember the MiB that a render of this size added, with the network `loaded` before it or not."""
    _latest(_memory, _memory_key(setup, loaded), [])[:] = added, pixels, triangles


def measured_memory(setup: str, loaded: bool, pixels: int, triangles: int, is_published: bool = False) -> float | None:
    """MiB that a render will add, from what the last one in this setup did; None if there was none.

    What is smaller than in the last one, picture or scene, adds what is usual for it, and all that the last one needed
    beyond the usual, which its objects and images may have taken; but no more than the last one. What is larger adds
    what it usually needs more.
    """
    last = _memory.get(_memory_key(setup, loaded)) or _memory.get(setup)
    if not last:
        return None
    added, last_pixels, last_triangles = last
    if loaded and _memory_key(setup, loaded) not in _memory:
        added = max(added - (FIXED - FIXED_LOADED), 0.0)  # it included loading the network
    usual = partial(_usual_memory, loaded, is_published)
    smaller = usual(min(pixels, last_pixels), min(triangles, last_triangles))
    kept = min(added, smaller + max(added - usual(last_pixels, last_triangles), 0.0))
    return kept + usual(pixels, triangles) - smaller


def _usual_memory(loaded: bool, is_published: bool, pixels: float, triangles: float) -> float:
    """MiB that no render of a small scene on a CPU has exceeded: a fixed part, one of the picture, one of the scene."""
    of_pixels = PIXEL * min(pixels, LARGE) + PIXEL_BEYOND * max(pixels - LARGE, 0)
    of_triangles = (PUBLISHED_TRIANGLE if is_published else TRIANGLE) * triangles
    return (FIXED_LOADED if loaded else FIXED) + (of_pixels + of_triangles) / (1 << 20)


def _memory_key(setup: str, loaded: bool) -> str:
    return f"{setup} loaded" if loaded else setup


def _latest(costs: dict, setup: str, empty):
    """The entry of a setup, moved to the end; the oldest is dropped if there are too many."""
    costs[setup] = costs.pop(setup, empty)
    if len(costs) > MOST_SETUPS:
        del costs[next(iter(costs))]
    return costs[setup]


def _file() -> Path | None:
    folder = extension.user_folder(create=True)
    return folder and folder / "costs.json"


@persistent
def save(*_) -> None:
    """Write the costs to disk; if that fails they are guessed again."""
    try:
        if file := _file():
            new = file.with_suffix(".new")
            new.write_text(json.dumps({"seconds": _measured, "memory": _memory}))
            os.replace(new, file)
    except OSError:
        pass


def load() -> None:
    """Read the costs of earlier sessions."""
    try:
        saved = json.loads(_file().read_text())
        seconds = {setup: {key: float(cost) for key, cost in row.items()} for setup, row in saved["seconds"].items()}
        memory = {setup: [float(x) for x in row] for setup, row in saved["memory"].items() if len(row) == 3}
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return  # there is no such file, or not one of ours
    _measured.update(seconds)
    _memory.update(memory)


_add_handlers, unregister = handlers(("render_complete", save))


def register() -> None:
    load()
    _add_handlers()
