# SPDX-License-Identifier: GPL-3.0-or-later
"""A transformer of one's own sizes with new weights, in a bundle of the published format."""
from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import torch
import yaml
from safetensors.torch import save_file
from torch import nn

from renderformer_v2.model.guided.network import new_network
from renderformer_v2.model.network.config import ModelConfig
from renderformer_v2.model.network.renderformer import RenderFormer
from renderformer_v2.model.published.bundle_files import SMALL
from renderformer_v2.model.published.model_config import FIXED, OWN

WEIGHTS = "model.safetensors"
FIRST_BIAS = 0.1  # of the log image: a channel that starts below zero has a thousandth of the gradients


def new_transformer(config: ModelConfig) -> RenderFormer:
    """A network with new weights, whose first pictures are not black."""
    network = new_network(config)
    nn.init.constant_(network.view_transformer.out_dpt.scratch.output_conv2[-1].bias, FIRST_BIAS)
    return network


def published_mapping(config: ModelConfig) -> dict:
    """`model_config` as a published config.yaml has it."""
    own = {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(config).items() if k not in OWN}
    return own | {name: position for name, (position, _) in FIXED.items()} | {"use_flex_attention": True}


def write_published(folder: Path, config: ModelConfig, state: dict[str, torch.Tensor]) -> None:
    """config.yaml and model.safetensors, as a published bundle has them in `transformer_512`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config.yaml").write_text(yaml.safe_dump({"model_config": published_mapping(config)}))
    save_file({name: tensor.detach().contiguous() for name, tensor in state.items()}, folder / WEIGHTS)


def add_new_transformer(bundle: Path, config: ModelConfig) -> None:
    """Give a bundle that has none a `transformer_512` with new weights."""
    torch.manual_seed(0)
    write_published(bundle / SMALL, config, new_transformer(config).state_dict())
