# SPDX-License-Identifier: GPL-3.0-or-later
"""A tiny network with every mechanism, and inputs for it."""
from dataclasses import replace

import pytest
import torch

from model.config import ModelConfig, rf2_200m
from model.inputs import EnvironmentInputs, NetworkInputs, VolumeInputs
from tools.fixture_cases import recipe_network


@pytest.fixture(scope="session")
def tiny_config() -> ModelConfig:
    return replace(
        rf2_200m(), latent_dim=48, num_layers=2, num_heads=2, dim_feedforward=64, num_register_tokens=3,
        vertex_pe_num_freqs=3, intra_rope_pe_num_freqs=8, vn_pe_num_freqs=2, texture_channels=4,
        envmap_latent_channels=2, envmap_ray_dir_map_patch_size=4, local_attention_window_size_half=5,
        summary_block_size=4, view_transformer_latent_dim=48, view_transformer_ffn_hidden_dim=64,
        view_transformer_n_heads=2, view_transformer_n_layers=4, dpt_features=8, dpt_out_channels=(6, 8, 10, 12))


@pytest.fixture(scope="session")
def tiny_network(tiny_config):
    return recipe_network(tiny_config)


@pytest.fixture
def tiny_inputs() -> NetworkInputs:
    generator = torch.Generator().manual_seed(1)

    def random(*shape):
        return torch.randn(*shape, generator=generator)

    light = torch.zeros(50, 3)
    light[[7, 30]] = 2.0
    triangles = random(50, 1, 3) / 4 + random(50, 3, 3) / 50
    return NetworkInputs(
        triangles, torch.nn.functional.normalize(random(50, 3, 3), dim=-1), random(5, 4, 4, 4),
        torch.arange(50) % 5, light, EnvironmentInputs(random(2, 32, 64), random(2, 32, 64), torch.ones(1)),
        VolumeInputs(random(6, 64), random(6, 3) / 4, random(6, 3), random(6, 3), random(6, 3), random(6, 3)))


@pytest.fixture
def rays() -> tuple[torch.Tensor, torch.Tensor]:
    directions = torch.randn(2, 64, 64, 3, generator=torch.Generator().manual_seed(2))
    directions = torch.nn.functional.normalize(directions, dim=-1)
    return torch.tensor([[0.0, 0.0, 2.0], [1.0, -1.0, 0.5]]), directions
