# SPDX-License-Identifier: GPL-3.0-or-later
"""Convolutions of full resolution: the last layers of the decoder, which join features of the transformer with those of
pixels and their neighbours; and the layers that predict kernels for finished pictures."""
from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional as F

from ..network.layers import Conv2d, Float32Conv2d

DILATIONS = 1, 2, 4
REACH = 1 + sum(DILATIONS)  # pixels around one that it depends on


class PixelDecoder(nn.Module):
    """(V, inputs, H, W) -> (V, outputs, H, W) f32; zeros before it is trained."""

    def __init__(self, inputs: int, width: int, outputs: int):
        super().__init__()
        self.enter = Conv2d(inputs, width, 3, padding=1)
        self.look = nn.ModuleList(Conv2d(width, width, 3, padding=d, dilation=d) for d in DILATIONS)
        self.leave = Float32Conv2d(width, outputs, 1)
        for p in self.leave.parameters():
            nn.init.zeros_(p)

    def forward(self, inputs: Tensor) -> Tensor:
        x = F.silu(self.enter(inputs.to(self.enter.weight.dtype)))
        for look in self.look:
            x = x + F.silu(look(x))
        return self.leave(x)
