# SPDX-License-Identifier: GPL-3.0-or-later
"""The stages of a training, one after the other: which samples, and what the network's tokens see of each other."""
from __future__ import annotations

from collections.abc import Callable, Iterator

from renderformer_v2.model.network.renderformer import RenderFormer

from .config import Stage, TrainConfig
from .state import TrainingState


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
