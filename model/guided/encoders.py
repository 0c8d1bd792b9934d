# SPDX-License-Identifier: GPL-3.0-or-later
"""The guided network's own encoders: of textures and environment, in place of the VAE, and of guides and beams."""
from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..compute.inference import is_inference
from ..material.mappers import LATENT_DIM
from ..network.config import ModelConfig
from ..network.embedding import ENVIRONMENT_GRID
from ..network.layers import Linear, RMSNorm
from ..pictures import bands
from ..progress import steps
from ..scene import HEIGHT, NORMAL
from .features import FEATURES, GuidedView

TILE_CHANNELS = LATENT_DIM + HEIGHT + 1 - NORMAL.start  # appearance latent, normal, height
BEAM_FEATURES = 5       # axis and two cosines of a light triangle's beam
BAND_PIXELS = 1 << 17   # embedded at a time
FARTHEST = 5.0          # standard deviations from the mean that count


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


class Standardization(nn.Module):
    """Numbers (..., count) of mean 0 and standard deviation 1 over what a network was trained with."""

    def __init__(self, count: int):
        super().__init__()
        self.mean, self.scale = (nn.Parameter(torch.full((count,), value)) for value in (0.0, 1.0))

    def forward(self, x: Tensor) -> Tensor:
        return ((x - self.mean.float()) * self.scale.float()).clamp(-FARTHEST, FARTHEST)


class BundleStatistics(nn.Module):
    """(V, len(FEATURES), h, W) features of pixels -> (V, R, D) of their ray bundles; zeros before it is trained.

    Means and standard deviations, and how far traced light is from its estimate: what a product of all pixels cannot
    tell.
    """

    SOME = slice(0, FEATURES["emitters"].start)
    COUNT = 2 * SOME.stop + 3

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.patch_size = config.patch_size
        self.standardize = Standardization(self.COUNT)
        self.project = Linear(self.COUNT, config.latent_dim, bias=False)
        nn.init.zeros_(self.project.weight)

    def forward(self, features: Tensor) -> Tensor:
        return self.project(self.standardize(self.of(features)))

    def of(self, features: Tensor) -> Tensor:
        """(V, R, COUNT) the numbers themselves."""
        some, difference = features[:, self.SOME], features[:, FEATURES["traced"]] - features[:, FEATURES["estimated"]]
        mean, square, error = (F.avg_pool2d(x, self.patch_size) for x in (some, some.square(), difference.abs()))
        deviation = (square - mean.square()).clamp_min(0).sqrt()
        return torch.cat([mean, deviation, error], 1).flatten(2).transpose(1, 2)


class Guidance(nn.Module):
    """Embeds features of pixels into ray-bundle tokens, and beams into light tokens."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.patch_size = config.patch_size
        self.bundle_encoder = Linear(len(FEATURES) * config.patch_size ** 2, config.latent_dim)
        self.bundle_norm = RMSNorm(config.latent_dim, config.embed_norm_eps)
        self.statistics = BundleStatistics(config)
        self.beam_encoder = Linear(BEAM_FEATURES, config.latent_dim)

    def bundles(self, view: GuidedView) -> Tensor:
        """(V, R, D), added to the ray tokens."""
        views, _, height, width = view.surface.shape
        pixels = BAND_PIXELS // views if is_inference() else height * width
        return torch.cat([self._embed(view.features(rows)) for rows, _ in steps(bands(
            height, width, margin=0, pixels=pixels, multiple=self.patch_size))], 1)

    def _embed(self, band: Tensor) -> Tensor:
        patches = F.pixel_unshuffle(band, self.patch_size)
        return self.bundle_norm(self.bundle_encoder(patches.flatten(2).transpose(1, 2))) + self.statistics(band)

    def beams(self, axis: Tensor, cosine: Tensor) -> Tensor:
        """(L, D) added to the tokens of L light triangles; axis (L, 3), cosine (L, 2)."""
        is_beam = (axis.square().sum(-1, keepdim=True) > 0.25).to(axis.dtype)
        return self.beam_encoder(torch.cat([axis, cosine], -1) * is_beam)
