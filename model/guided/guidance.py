# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers that embed guides into tokens (docs/architecture.md 4.2). A network without guidance has none of them."""
from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..network.config import ModelConfig
from ..network.layers import Linear, RMSNorm
from .features import FEATURES

BEAM_FEATURES = 5       # axis and two cosines of a light triangle's beam
BAND_PIXELS = 1 << 17   # embedded at a time


class Guidance(nn.Module):
    """Embeds features of pixels into ray-bundle tokens, and beams into light tokens."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.patch_size = config.patch_size
        self.bundle_encoder = Linear(len(FEATURES) * config.patch_size ** 2, config.latent_dim)
        self.bundle_norm = RMSNorm(config.latent_dim, config.embed_norm_eps)
        self.beam_encoder = Linear(BEAM_FEATURES, config.latent_dim)

    def bundles(self, features: Tensor) -> Tensor:
        """(V, len(FEATURES), H, W) -> (V, R, D), added to the ray tokens."""
        views, _, height, width = features.shape
        rows = max(BAND_PIXELS // (views * width) // self.patch_size, 1) * self.patch_size
        return torch.cat([self._embed(band) for band in features.split(height if self.training else rows, dim=2)], 1)

    def _embed(self, band: Tensor) -> Tensor:
        patches = F.pixel_unshuffle(band, self.patch_size)
        return self.bundle_norm(self.bundle_encoder(patches.flatten(2).transpose(1, 2)))

    def beams(self, axis: Tensor, cosine: Tensor) -> Tensor:
        """(L, D) added to the tokens of L light triangles; axis (L, 3), cosine (L, 2)."""
        is_beam = (axis.square().sum(-1, keepdim=True) > 0.25).to(axis.dtype)
        return self.beam_encoder(torch.cat([axis, cosine], -1) * is_beam)
