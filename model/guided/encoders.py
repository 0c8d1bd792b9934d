# SPDX-License-Identifier: GPL-3.0-or-later
"""The small preset's own encoders, in place of the published network's VAE: no download, trained with the network."""
from __future__ import annotations

import torch
from torch import nn

TILE_CHANNELS = 13     # 9 appearance latent, 3 normal, 1 height
TILE_SIDE = 8          # texels; material tiles are area-averaged to this before they are encoded
PANORAMA = (64, 128)   # rows, columns; environments likewise


class _Convolution(nn.Sequential):
    """nn.Sequential that takes any input dtype."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x.to(self[0].weight.dtype))


class TileEncoder(_Convolution):
    """(T, 13, 8, 8) material tiles -> (T, out, 4, 4) latents."""

    def __init__(self, hidden: int, out: int):
        super().__init__(nn.Conv2d(TILE_CHANNELS, hidden, 3, stride=2, padding=1), nn.SiLU(), nn.Conv2d(hidden, out, 1))


class EnvironmentEncoder(_Convolution):
    """(B, 3, 64, 128) panoramas in [-1, 1] -> (B, out, 32, 64) latents."""

    def __init__(self, out: int, hidden: int = 32):
        super().__init__(nn.Conv2d(3, hidden, 3, stride=2, padding=1), nn.SiLU(), nn.Conv2d(hidden, out, 1))
