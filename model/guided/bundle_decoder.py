# SPDX-License-Identifier: GPL-3.0-or-later
"""From ray bundles back to their pixels: what the transformer says, for the pixel decoder."""
from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional as F

from ..network.config import ModelConfig
from ..network.layers import Linear, RMSNorm


class BundleDecoder(nn.Module):
    """Features of ray bundles after the last view layer -> channels of every pixel, by one product for each bundle.

    The paper's decoder (`network/decoder.py`) has convolutions without norms, whose gain grew a million times within
    the few minutes of our training; after that all pixels heard the same. The pixel decoder sees neighbours anyway.
    """

    def __init__(self, config: ModelConfig, channels: int):
        super().__init__()
        self.patch_size = config.patch_size
        self.norm = RMSNorm(config.view_transformer_latent_dim)
        self.project = Linear(config.view_transformer_latent_dim, channels * config.patch_size ** 2)

    def forward(self, features: Tensor, rows: slice) -> Tensor:
        """`rows` of the pixels of (V, D, Hg, Wg) -> (V, channels, h, W)."""
        first, last = rows.start // self.patch_size, -(-rows.stop // self.patch_size)
        said = self.project(self.norm(features[..., first:last, :].movedim(1, -1)))
        pixels = F.pixel_shuffle(said.movedim(-1, 1), self.patch_size)
        return pixels[..., rows.start - first * self.patch_size:rows.stop - first * self.patch_size, :]
