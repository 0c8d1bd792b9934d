# SPDX-License-Identifier: GPL-3.0-or-later
"""The configuration of a training: preset, optimiser and curriculum, read from a JSON file."""
from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path

from torch import nn

from renderformer_v2.model.errors import CheckpointError
from renderformer_v2.model.network.config import ModelConfig
from renderformer_v2.model.network.renderformer import RenderFormer
from renderformer_v2.model.weights.presets import PRESETS
from tools.datagen.sample_files import Facts

from .errors import TrainingError
from .state import TrainingState

LEAST_RATE = 0.01  # of the learning rate, where the cosine ends
KINDS = "textures", "environment", "volumes", "transmission"  # that a stage admits or does not


@dataclass(frozen=True)
class Stage:
    """A stretch of the curriculum: until `steps` in total, only scenes that pass the limits."""

    steps: int                   # counted from the start of training
    max_triangles: int | None = None
    textures: bool = True        # scenes with materials that vary within a triangle
    environment: bool = True     # scenes that the world lights
    volumes: bool = True         # scenes with participating media
    transmission: bool = True    # scenes with glass
    rays: float = 0.25           # share of samples whose traced light is withheld, and of those that
    scene: float = 0.1           # know direct light without shadows only
    augmented: bool = True       # whether prepared samples are turned, resized, mirrored and recoloured at random
    dense: bool = False          # stage 1 of the network sees all tokens instead of a window
    views: int | None = None     # drawn from those of a sample; only published networks heed this,
    crop: int | None = None      # and the pixels of squares that are cut out of the views

    def admits_all(self) -> bool:
        return self.max_triangles is None and all(getattr(self, kind) for kind in KINDS)

    def admits(self, scene: Facts) -> bool:
        """Whether a scene belongs to this stage."""
        few = self.max_triangles is None or scene.triangles <= self.max_triangles
        return few and all(getattr(self, kind) or not getattr(scene, kind) for kind in KINDS)


@dataclass(frozen=True)
class TrainConfig:
    preset: str                  # a name of model.weights.presets.PRESETS
    learning_rate: float
    weight_decay: float
    warmup_steps: int
    scenes_per_step: int         # gradients of this many scenes (all their views) make one step
    clip_norm: float
    average_decay: float         # of the weights' running average, which is what is saved for rendering
    stages: tuple[Stage, ...]    # the last one lasts until the run ends
    cosine_steps: int | None = None  # after the warm-up, in which the rate falls to LEAST_RATE; None: it stays
    network: dict = field(default_factory=dict)  # settings of ModelConfig that differ from the preset's (ablations)
    muon: tuple[str, ...] = ()   # how the names of the layers begin whose matrices Muon updates, not AdamW,
    muon_rate: float = 1.0       # with this factor on the learning rate
    parts: tuple[str, ...] = ("",)  # how the names of the tensors begin that are trained; the others stay
    copies: int = 1              # of a published sample: itself, and others that are turned and recoloured
    offset: float = 0.0          # network units by which they are moved, standard deviation along each axis
    recomputed: tuple[str, ...] = ()  # how the names of the layers begin that tools/train/memory.py computes twice

    @classmethod
    def load(cls, path: Path) -> TrainConfig:
        """Raises TrainingError naming the file and the keys that are not known, not there or of no use."""
        try:
            values = json.loads(path.read_text())
        except (OSError, ValueError) as error:
            raise TrainingError(f"{path} cannot be read ({error}): choose another --config") from error
        config = _filled(cls, values, str(path))
        if config.preset not in tuple(PRESETS):
            raise TrainingError(f"{path}: preset must be one of {', '.join(PRESETS)}, not {config.preset!r}")
        config.model(str(path))
        if not isinstance(config.stages, list) or not config.stages:
            raise TrainingError(f"{path}: stages must be a list of at least one stage")
        stages = (_filled(Stage, stage, f"{path}, stages[{i}]") for i, stage in enumerate(config.stages))
        return replace(config, stages=tuple(stages))

    def model(self, where: str = "network") -> ModelConfig:
        """The preset with the settings of `network`.

        Raises TrainingError for one that does not exist.
        """
        try:
            if not isinstance(self.network, dict):
                raise CheckpointError("network must be a JSON object")
            return ModelConfig.from_dict(PRESETS[self.preset]().to_dict() | self.network)
        except CheckpointError as error:
            raise TrainingError(f"{where}: {error}") from error

    def train(self, model: nn.Module) -> None:
        """Switch gradients on for `parts` of a model, but never for the frequencies of its positions, and else off.

        Raises TrainingError for a part that the model does not have.
        """
        names = [name for name, _ in model.named_parameters()]
        for part in self.parts:
            if not any(name.startswith(part) for name in names):
                raise TrainingError(f"parts: no tensor's name begins with {part!r}")
        for name, p in model.named_parameters():
            p.requires_grad_(name.startswith(tuple(self.parts)) and not name.endswith("rope_emb.freqs"))

    def rate(self, step: int) -> float:
        """The learning rate of step 0, 1, ..."""
        if step < self.warmup_steps:
            return self.learning_rate * (step + 1) / self.warmup_steps
        fallen = min((step - self.warmup_steps) / self.cosine_steps, 1.0) if self.cosine_steps else 0.0
        return self.learning_rate * (LEAST_RATE + (1 - LEAST_RATE) * (1 + math.cos(math.pi * fallen)) / 2)

    def stage(self, step: int) -> Stage:
        return next((s for s in self.stages if step < s.steps), self.stages[-1])


def _filled(kind, values, where: str):
    """A dataclass from a JSON object. Raises TrainingError beginning with `where`."""
    if not isinstance(values, dict):
        raise TrainingError(f"{where}: expected a JSON object, not {json.dumps(values)}")
    names = {f.name for f in fields(kind)}
    needed = {f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING}
    for wrong, keys in (("unknown", set(values) - names), ("missing", needed - set(values))):
        if keys:
            raise TrainingError(f"{where}: {wrong} keys {', '.join(sorted(keys))}")
    return kind(**values)


def iterate_stages(config: TrainConfig, state: TrainingState, begin: Callable[[Stage], Iterator]) -> Iterator:
    """Samples of the stage that each step belongs to; `begin(stage)` gives them from that step on."""
    stage, samples = None, iter(())
    while True:
        if config.stage(state.step) != stage:
            stage = config.stage(state.step)
            set_attention(state.model, dense=stage.dense)
            samples = begin(stage)
        yield next(samples)


def set_attention(network: RenderFormer, *, dense: bool) -> None:
    """All tokens of stage 1, or those of the window of the network's configuration. The weights are the same."""
    window = None if network.config.dense else network.config.local_attention_window_size_half
    network.transformer.half = None if dense else window
