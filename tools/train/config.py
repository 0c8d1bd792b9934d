# SPDX-License-Identifier: GPL-3.0-or-later
"""How to train: preset, optimiser and the curriculum, read from a JSON file."""
from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path

from .errors import TrainingError


@dataclass(frozen=True)
class Stage:
    """A stretch of the curriculum: until `steps` in total, only scenes that pass the limits."""

    steps: int                   # counted from the start of training
    max_triangles: int = 10**9
    volumes: bool = True         # scenes with participating media
    transmission: bool = True    # scenes with glass
    unhinted: float = 0.2        # share of samples whose traced light is withheld, for "Network Alone"


@dataclass(frozen=True)
class TrainConfig:
    preset: str                  # a name of model.config.PRESETS
    learning_rate: float
    weight_decay: float
    warmup_steps: int
    scenes_per_step: int         # gradients of this many scenes (all their views) make one step
    clip_norm: float
    average_decay: float         # of the weights' running average, which is what is saved for rendering
    stages: tuple[Stage, ...]    # the last one goes on for as long as the run is given

    @classmethod
    def load(cls, path: Path) -> TrainConfig:
        """Raises TrainingError naming the file and the keys that are not known or not there."""
        try:
            values = json.loads(path.read_text())
        except (OSError, ValueError) as error:
            raise TrainingError(f"{path} cannot be read ({error}): choose another --config") from error
        names = {f.name for f in fields(cls)}
        for wrong, keys in (("unknown", set(values) - names), ("missing", names - set(values))):
            if keys:
                raise TrainingError(f"{path}: {wrong} keys {', '.join(sorted(keys))}")
        return cls(**values | {"stages": tuple(Stage(**s) for s in values["stages"])})

    def stage(self, step: int) -> Stage:
        return next((s for s in self.stages if step < s.steps), self.stages[-1])
