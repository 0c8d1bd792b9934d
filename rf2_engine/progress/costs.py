# SPDX-License-Identifier: GPL-3.0-or-later
"""Remember the seconds that the stages of a render took on this machine, between sessions of Blender.

They belong to a setup: the settings that, apart from the amount of work, decide how long a stage takes.
"""
from __future__ import annotations

import json
import os
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from ..registering import handlers
from ..setup import packages
from .stages import Stage, Work

LEAST_LEARNED = 0.5   # least factor on a known cost: a stage whose work was done already tells little about the next
MOST_SETUPS = 20      # the latest are remembered

_measured: dict[str, dict[str, float]] = {}  # seconds for a unit, by setup and key
_memory: dict[str, list[float]] = {}         # MiB that a render added, its pixels and its triangles, by setup


def seconds(stage: Stage, units: float, setup: str = "") -> float:
    """Expected seconds of so many units of a stage's work: as in this setup, or else as in any."""
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
    """Remember the seconds taken by so many units of a stage's work."""
    if units:
        costs = _latest(_measured, setup, {})
        costs[stage.key] = max(taken / units, LEAST_LEARNED * costs.get(stage.key, 0.0))


def learn_memory(setup: str, loaded: bool, added: float, pixels: int, triangles: int) -> None:
    """Remember the MiB that a render of this size added, with the network `loaded` before it or not."""
    _latest(_memory, _memory_key(setup, loaded), [])[:] = added, pixels, triangles


def measured_memory(setup: str, loaded: bool, pixels: int, triangles: int) -> float | None:
    """MiB that a render will add, in proportion to the picture or the scene, whichever grew more; None if unknown."""
    before = _memory.get(_memory_key(setup, loaded)) or _memory.get(setup)  # more, as it includes loading the network
    if not before:
        return None
    added, before_pixels, before_triangles = before
    return added * max(1.0, pixels / max(before_pixels, 1), triangles / max(before_triangles, 1))


def _memory_key(setup: str, loaded: bool) -> str:
    return f"{setup} loaded" if loaded else setup


def _latest(costs: dict, setup: str, empty):
    """The entry of a setup, moved to the end; the oldest is dropped if there are too many."""
    costs[setup] = costs.pop(setup, empty)
    if len(costs) > MOST_SETUPS:
        del costs[next(iter(costs))]
    return costs[setup]


def _file() -> Path | None:
    if not packages.is_extension():
        return None  # Blender has no folder for the add-on
    return Path(bpy.utils.extension_path_user(packages.EXTENSION, create=True)) / "costs.json"


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
