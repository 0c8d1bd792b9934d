# SPDX-License-Identifier: GPL-3.0-or-later
"""Convolutions of full resolution: the last layers of the decoder, which join features of the transformer with those of
pixels and their neighbours; and the layers that predict kernels for finished pictures."""
from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional as F

from ..network.layers import Conv2d, Float32Conv2d

DILATIONS = 1, 2, 4
COARSE_DILATIONS = 1, 2, 4, 8
REACH = 1 + sum(DILATIONS)  # pixels around one that it depends on
REACH_OF_COARSE = REACH + 2 * sum(COARSE_DILATIONS) + 2  # with coarse layers; even, so that parts of a picture agree


class CoarseLayers(nn.Module):
    """(V, width, H, W) -> the same, seen at half resolution; zeros before it is trained. H and W are even."""

    def __init__(self, width: int, coarse_width: int):
        super().__init__()
        self.halve = Conv2d(width, coarse_width, 2, stride=2)
        self.look = nn.ModuleList(Conv2d(coarse_width, coarse_width, 3, padding=d, dilation=d)
                                  for d in COARSE_DILATIONS)
        self.enlarge = Conv2d(coarse_width, 4 * width, 1)
        for p in self.enlarge.parameters():
            nn.init.zeros_(p)

    def forward(self, x: Tensor) -> Tensor:
        x = F.silu(self.halve(x))
        for look in self.look:
            x = x + F.silu(look(x))
        return F.pixel_shuffle(self.enlarge(x), 2)


class PixelDecoder(nn.Module):
    """(V, inputs, H, W) -> (V, outputs, H, W) f32; zeros before it is trained."""

    def __init__(self, inputs: int, width: int, outputs: int, coarse_width: int = 0):
        super().__init__()
        self.enter = Conv2d(inputs, width, 3, padding=1)
        self.coarse = CoarseLayers(width, coarse_width) if coarse_width else None
        self.look = nn.ModuleList(Conv2d(width, width, 3, padding=d, dilation=d) for d in DILATIONS)
        self.leave = Float32Conv2d(width, outputs, 1)
        for p in self.leave.parameters():
            nn.init.zeros_(p)

    @property
    def reach(self) -> int:
        """Pixels around one that it depends on."""
        return REACH if self.coarse is None else REACH_OF_COARSE

    def forward(self, inputs: Tensor) -> Tensor:
        x = F.silu(self.enter(inputs.to(self.enter.weight.dtype)))
        if self.coarse is not None:
            x = x + self.coarse(x)
        for look in self.look:
            x = x + F.silu(look(x))
        return self.leave(x)
