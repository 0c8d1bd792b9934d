# SPDX-License-Identifier: GPL-3.0-or-later
"""The last look at the decoder's channels: a small U-Net that knows the pixels around (docs/architecture.md).

A ray bundle is eight pixels wide, and the decoder's last convolutions see no farther than its neighbours. What lies
between, noise of traced light among it, is seen here, at several scales (Ronneberger et al. 2015).
"""
from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..bands import bands
from ..network.decoder import ResidualConvUnit
from ..network.norm import Float32Conv2d

LEVELS = 4
COARSEST = 2 ** (LEVELS - 1)  # pixels along a cell of the coarsest level
REACH = 9 * COARSEST          # pixels: what lies farther away does not count
BAND_PIXELS = 1 << 19         # computed at once


class Refiner(nn.Module):
    """(V, in_channels, H, W) -> (V, out_channels, H, W) float32; H and W are multiples of COARSEST.

    Without gradients a large picture is refined in bands: the same numbers in bounded memory.
    """

    def __init__(self, in_channels: int, width: int, out_channels: int):
        super().__init__()
        widths = [width * (level + 1) for level in range(LEVELS)]
        self.enter = nn.Conv2d(in_channels, width, 3, padding=1)
        self.reduce = nn.ModuleList(nn.Conv2d(a, b, 3, stride=2, padding=1) for a, b in zip(widths, widths[1:]))
        self.encode = nn.ModuleList(ResidualConvUnit(w) for w in widths[1:])
        self.enlarge = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in zip(widths, widths[1:]))
        self.decode = nn.ModuleList(ResidualConvUnit(w) for w in widths[:-1])
        self.leave = Float32Conv2d(width, out_channels, 1)
        nn.init.zeros_(self.leave.weight)  # untrained it changes nothing
        nn.init.zeros_(self.leave.bias)

    def forward(self, *parts: Tensor) -> Tensor:
        """`parts` (V, C, H, W) are the input channels, one behind the other."""
        views, _, height, width = parts[0].shape
        pixels = height * width if torch.is_grad_enabled() else BAND_PIXELS // views
        done = []
        for outer, inner in bands(height, width, REACH, pixels, COARSEST):
            done.append(self._refined(torch.cat([part[:, :, outer].float() for part in parts], 1))[:, :, inner])
        return torch.cat(done, 2)

    def _refined(self, x: Tensor) -> Tensor:
        x = x.to(self.enter.weight.dtype)
        levels = [self.enter(x)]
        for reduce, encode in zip(self.reduce, self.encode, strict=True):
            levels.append(encode(reduce(F.silu(levels[-1]))))
        x = levels.pop()
        for enlarge, decode in zip(reversed(self.enlarge), reversed(self.decode), strict=True):
            x = decode(levels.pop() + F.interpolate(enlarge(x), scale_factor=2.0, mode="bilinear"))
        return self.leave(F.silu(x))
