# SPDX-License-Identifier: GPL-3.0-or-later
"""The guided network's own encoders, in place of the published network's VAE: no download, trained with the network."""
from __future__ import annotations

import torch
from torch import nn

from ..material.mappers import LATENT_DIM
from ..network.config import ModelConfig
from ..network.embedding import ENVIRONMENT_GRID
from ..scene import HEIGHT, NORMAL

TILE_CHANNELS = LATENT_DIM + HEIGHT + 1 - NORMAL.start  # appearance latent, normal, height


class _Halving(nn.Sequential):
    """Two convolutions, the first of stride 2; takes any input dtype."""

    def __init__(self, channels: int, width: int, out: int):
        super().__init__(nn.Conv2d(channels, width, 3, stride=2, padding=1), nn.SiLU(), nn.Conv2d(width, out, 1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x.to(self[0].weight.dtype))


class TileEncoder(_Halving):
    """(T, 13, 2 q, 2 q) material tiles -> (T, texture_channels, q, q) latents."""

    def __init__(self, config: ModelConfig):
        super().__init__(TILE_CHANNELS, config.guidance.tile_encoder_width, config.texture_channels)


class EnvironmentEncoder(_Halving):
    """(B, 3, *panorama_size) panoramas in [-1, 1] -> (B, envmap_latent_channels, ...) latents of half the size."""

    def __init__(self, config: ModelConfig):
        super().__init__(3, config.guidance.environment_encoder_width, config.envmap_latent_channels)


def tile_side(config: ModelConfig) -> int:
    """Texels: material tiles are area-averaged to this before they are encoded."""
    return 2 * config.texture_encode_patch_size


def panorama_size(config: ModelConfig) -> tuple[int, int]:
    """Rows and columns; environments likewise."""
    rows, columns = (2 * count * config.envmap_latent_patch_size for count in ENVIRONMENT_GRID)
    return rows, columns
