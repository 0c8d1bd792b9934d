# SPDX-License-Identifier: GPL-3.0-or-later
"""Guided weights for tests."""
from pathlib import Path

import torch

from renderformer_v2.model.guided.network import GuidedRenderFormer, load_network, new_network
from renderformer_v2.model.weights.checkpoint import save_network
from renderformer_v2.model.weights.presets import BUNDLED, rf2_small, weights_folder


def busy_network() -> GuidedRenderFormer:
    """The bundled kernels, and random weights that end in small numbers: the transformer has a say in every pixel."""
    torch.manual_seed(0)
    network = new_network(rf2_small())
    network.kernel_predictor = load_network(weights_folder(BUNDLED)).kernel_predictor
    torch.nn.init.normal_(network.pixel_decoder.leave.weight, std=0.01)
    for part in (network.bundle_decoder, network.traced_fusion, network.rays_fusion):
        torch.nn.init.normal_(part.project.weight, std=0.01)
    return network.requires_grad_(False).eval()


def write(folder: Path, network: GuidedRenderFormer) -> Path:
    """The folder, which holds this network now."""
    save_network(folder, network.config, network.state_dict())
    return folder
