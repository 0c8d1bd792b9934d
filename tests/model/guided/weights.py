# SPDX-License-Identifier: GPL-3.0-or-later
"""Guided weights for tests."""
from pathlib import Path

import torch

from renderformer_v2.model.checkpoint import load_network, save_network
from renderformer_v2.model.presets import BUNDLED, weights_folder


def write_busy(folder: Path) -> Path:
    """The bundled weights with a decoder that ends in small numbers: the transformer has a say in every pixel."""
    network = load_network(weights_folder(BUNDLED))
    last = network.view_transformer.out_dpt.scratch.output_conv2[-1]
    torch.manual_seed(0)
    torch.nn.init.normal_(last.weight, std=0.01)
    save_network(folder, network.config, network.state_dict())
    return folder
