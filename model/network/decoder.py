# SPDX-License-Identifier: GPL-3.0-or-later
"""DPT decoder: four levels of ray tokens -> full-resolution channels (docs/network.md 9)."""
from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from ..compute.inference import divided
from ..progress import part, report
from .banded import Rows, added, combined, convolved, enlarged, resized, whole
from .config import ModelConfig
from .layers import Float32Conv2d

BAND_PIXELS = 1 << 16  # of one band of the picture: about 200 MB of published activations, and short polls


def resize(x: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Bilinear with aligned corners."""
    return x if x.shape[-2:] == size else F.interpolate(x, size=size, mode="bilinear", align_corners=True)


class ResidualConvUnit(nn.Module):
    """x + conv(silu(conv(silu(x))))."""

    def __init__(self, width: int):
        super().__init__()
        self.conv1 = nn.Conv2d(width, width, 3, padding=1)
        self.conv2 = nn.Conv2d(width, width, 3, padding=1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.conv2(F.silu(self.conv1(F.silu(x))))

    def rows(self, x: Rows) -> Rows:
        """The same by rows."""
        return added(x, convolved(self.conv2, convolved(self.conv1, x, F.silu), F.silu))


class FeatureFusion(nn.Module):
    """Add a finer level to the coarser result and enlarge the sum; the coarsest level has nothing to be added to."""

    def __init__(self, width: int, coarsest: bool):
        super().__init__()
        if not coarsest:
            self.resConvUnit1 = ResidualConvUnit(width)
        self.resConvUnit2 = ResidualConvUnit(width)
        self.out_conv = nn.Conv2d(width, width, 1)

    def forward(self, level: torch.Tensor, coarser: torch.Tensor | None, size: tuple[int, int]) -> torch.Tensor:
        x = level if coarser is None else coarser + self.resConvUnit1(level)
        # A 1x1 convolution commutes with the resize, and is cheaper before it.
        return resize(self.out_conv(self.resConvUnit2(x)), size)

    def rows(self, level: Rows, coarser: Rows | None, size: tuple[int, int]) -> Rows:
        """The same by rows."""
        x = level if coarser is None else combined(coarser, self.resConvUnit1.rows(level), torch.add)
        return resized(convolved(self.out_conv, self.resConvUnit2.rows(x)), size)


class DPTDecoder(nn.Module):
    """Reassemble four token grids into a pyramid and fuse it from coarse to fine."""

    def __init__(self, config: ModelConfig, extra_channels: int = 0, out_channels: int = 3):
        super().__init__()
        d, width, channels = config.view_transformer_latent_dim, config.dpt_features, config.dpt_out_channels
        self.patch_size = config.patch_size
        self.projects = nn.ModuleList(nn.Conv2d(d, c, 1) for c in channels)
        self.resize_layers = nn.ModuleList([
            nn.ConvTranspose2d(channels[0], channels[0], 4, stride=4),
            nn.ConvTranspose2d(channels[1], channels[1], 2, stride=2),
            nn.Identity(),
            nn.Conv2d(channels[3], channels[3], 3, stride=2, padding=1),
        ])
        self.scratch = nn.Module()
        for i, c in enumerate(channels, start=1):
            setattr(self.scratch, f"layer{i}_rn", nn.Conv2d(c, width, 3, padding=1, bias=False))
            setattr(self.scratch, f"refinenet{i}", FeatureFusion(width, coarsest=i == 4))
        self.scratch.output_conv1 = nn.Conv2d(width, width // 2, 3, padding=1)
        self.scratch.output_conv2 = nn.Sequential(
            nn.Conv2d(width // 2 + extra_channels, 32, 3, padding=1), nn.SiLU(),
            Float32Conv2d(32, out_channels, 1))  # log radiance needs more bits than bfloat16 has

    def forward(self, features: list[torch.Tensor], extra: torch.Tensor | None = None) -> torch.Tensor:
        """Four (V, D, Hg, Wg) -> (V, out_channels, 8 Hg, 8 Wg) float32.

        `extra` (V, extra_channels, 8 Hg, 8 Wg) joins the features before the last two convolutions. Without gradients a
        large picture is decoded in bands: the same numbers in bounded memory.
        """
        size = tuple(self.patch_size * side for side in features[0].shape[-2:])
        rows = max(divided(BAND_PIXELS) // (size[1] * len(features[0])), self.patch_size)
        if torch.is_grad_enabled() or rows >= size[0]:
            return self._whole(features, size, extra)
        return self._bands(features, size, extra, rows)

    def _whole(self, features, size, extra) -> torch.Tensor:
        scratch, dtype = self.scratch, self.projects[0].weight.dtype
        levels = []
        for i, feature in enumerate(features):
            level = self.resize_layers[i](self.projects[i](feature.to(dtype)))
            levels.append(getattr(scratch, f"layer{i + 1}_rn")(level))
            report(0.05 * i)
        x = None
        for i in (4, 3, 2, 1):
            level = levels[i - 1]
            target = levels[i - 2].shape[-2:] if i > 1 else tuple(2 * side for side in level.shape[-2:])
            x = getattr(scratch, f"refinenet{i}")(level, x, target)
            report(1.0 - 0.2 * i)
        x = resize(scratch.output_conv1(x), size)
        if extra is not None:
            x = torch.cat([x, extra.to(x.dtype)], dim=1)
        return scratch.output_conv2(x)

    def _bands(self, features, size, extra, rows: int) -> torch.Tensor:
        result, x = None, self._rows(features, size, extra)
        for begin in range(0, size[0], rows):
            with part(begin / size[0], min(begin + rows, size[0]) / size[0]):
                band = x(begin, begin + rows)
            if result is None:
                result = band.new_empty(*band.shape[:2], *size)
            result[:, :, begin:begin + rows] = band
        return result

    def _rows(self, features, size, extra) -> Rows:
        """What `_whole` returns, by rows."""
        scratch, levels = self.scratch, []
        for i, feature in enumerate(features):
            level = convolved(self.projects[i], whole(feature))
            resample = self.resize_layers[i]
            if isinstance(resample, nn.ConvTranspose2d):
                level = enlarged(resample, level)
            elif isinstance(resample, nn.Conv2d):
                level = convolved(resample, level)
            levels.append(convolved(getattr(scratch, f"layer{i + 1}_rn"), level))
        x = None
        for i in (4, 3, 2, 1):
            level = levels[i - 1]
            target = levels[i - 2].size if i > 1 else tuple(2 * side for side in level.size)
            x = getattr(scratch, f"refinenet{i}").rows(level, x, target)
        x = resized(convolved(scratch.output_conv1, x), size)
        if extra is not None:
            x = combined(x, whole(extra), lambda x, extra: torch.cat([x, extra.to(x.dtype)], dim=1))
        return convolved(scratch.output_conv2[2], convolved(scratch.output_conv2[0], x), F.silu)
