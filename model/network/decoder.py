# SPDX-License-Identifier: GPL-3.0-or-later
"""DPT decoder: four levels of ray tokens -> full-resolution channels (docs/network.md 9)."""
from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from ..compute.inference import current_pieces, is_inference
from .banded import Map, add_update, combine, convolve, enlarge, resize, rows_of, size
from .config import ModelConfig
from .layers import Conv2d, Float32Conv2d

BAND_PIXELS = 1 << 16  # of one band of the picture: about 200 MB of published activations, and short polls


class ResidualConvUnit(nn.Module):
    """x + conv(silu(conv(silu(x))))."""

    def __init__(self, width: int):
        super().__init__()
        self.conv1 = Conv2d(width, width, 3, padding=1)
        self.conv2 = Conv2d(width, width, 3, padding=1)

    def forward(self, x: Map) -> Map:
        return add_update(x, lambda x: convolve(self.conv2, convolve(self.conv1, x, F.silu), F.silu))


class FeatureFusion(nn.Module):
    """Add a finer level to the coarser result and enlarge the sum; the coarsest level has nothing to be added to."""

    def __init__(self, width: int, coarsest: bool):
        super().__init__()
        if not coarsest:
            self.resConvUnit1 = ResidualConvUnit(width)
        self.resConvUnit2 = ResidualConvUnit(width)
        self.out_conv = Conv2d(width, width, 1)

    def forward(self, level: Map, coarser: Map | None, target: tuple[int, int]) -> Map:
        x = level if coarser is None else combine(torch.add, coarser, self.resConvUnit1(level))
        # A 1x1 convolution commutes with the resize, and is cheaper before it.
        return resize(convolve(self.out_conv, self.resConvUnit2(x)), target)


class DPTDecoder(nn.Module):
    """Reassemble four token grids into a pyramid and fuse it from coarse to fine."""

    def __init__(self, config: ModelConfig, extra_channels: int = 0, out_channels: int = 3):
        super().__init__()
        d, width, channels = config.view_transformer_latent_dim, config.dpt_features, config.dpt_out_channels
        self.patch_size = config.patch_size
        self.projects = nn.ModuleList(Conv2d(d, c, 1) for c in channels)
        self.resize_layers = nn.ModuleList([
            nn.ConvTranspose2d(channels[0], channels[0], 4, stride=4),
            nn.ConvTranspose2d(channels[1], channels[1], 2, stride=2),
            nn.Identity(),
            Conv2d(channels[3], channels[3], 3, stride=2, padding=1),
        ])
        self.scratch = nn.Module()
        for i, c in enumerate(channels, start=1):
            setattr(self.scratch, f"layer{i}_rn", Conv2d(c, width, 3, padding=1, bias=False))
            setattr(self.scratch, f"refinenet{i}", FeatureFusion(width, coarsest=i == 4))
        self.scratch.output_conv1 = Conv2d(width, width // 2, 3, padding=1)
        self.scratch.output_conv2 = nn.Sequential(
            Conv2d(width // 2 + extra_channels, 32, 3, padding=1), nn.SiLU(),
            Float32Conv2d(32, out_channels, 1))  # log radiance needs more bits than bfloat16 has

    def forward(self, features: list[torch.Tensor], extra: torch.Tensor | None = None) -> torch.Tensor:
        """Four (V, D, Hg, Wg) -> (V, out_channels, 8 Hg, 8 Wg) float32.

        `extra` (V, extra_channels, 8 Hg, 8 Wg) joins the features before the last two convolutions. Inference decodes a
        large picture in bands: the same numbers in bounded memory.
        """
        height, width = (self.patch_size * side for side in features[0].shape[-2:])
        rows = max(current_pieces().limit(BAND_PIXELS) // (width * len(features[0])), self.patch_size)
        if not is_inference() or rows >= height:
            return self._decode(features, (height, width), extra)
        picture = self._decode([rows_of(feature) for feature in features], (height, width), extra)
        return picture.tensor(rows)

    def _decode(self, features: list[Map], target: tuple[int, int], extra: torch.Tensor | None) -> Map:
        scratch = self.scratch
        levels = [convolve(getattr(scratch, f"layer{i}_rn"), _resample(layer, convolve(project, feature)))
                  for i, (layer, project, feature) in enumerate(zip(self.resize_layers, self.projects, features), 1)]
        x = scratch.refinenet4(levels[3], None, size(levels[2]))
        x = scratch.refinenet3(levels[2], x, size(levels[1]))
        x = scratch.refinenet2(levels[1], x, size(levels[0]))
        height, width = size(levels[0])
        x = scratch.refinenet1(levels[0], x, (2 * height, 2 * width))
        x = resize(convolve(scratch.output_conv1, x), target)
        if extra is not None:
            extra = extra if isinstance(x, torch.Tensor) else rows_of(extra)
            x = combine(lambda x, extra: torch.cat([x, extra.to(x.dtype)], dim=1), x, extra)
        return convolve(scratch.output_conv2[2], convolve(scratch.output_conv2[0], x), F.silu)


def _resample(layer: nn.Module, x: Map) -> Map:
    """A level of the pyramid from tokens: larger, as it is, or smaller."""
    if isinstance(layer, nn.Identity):
        return x
    return enlarge(layer, x) if isinstance(layer, nn.ConvTranspose2d) else convolve(layer, x)
