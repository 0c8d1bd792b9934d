# SPDX-License-Identifier: GPL-3.0-or-later
"""A coarse look at the whole picture at the end: where it is too dark or too bright (docs/architecture.md)."""
from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..network.norm import Float32Conv2d, Linear

CELLS = 32               # along the longer side of a picture, or up to twice as many
CELL = 4, 64             # pixels along one at least and at most; powers of two in between
DILATIONS = (1, 4, 1, 4)
FARTHEST = 5.0           # deviations from the mean that are told apart
DROPPED = 0.2            # share of the channels that are left out while it is trained


class GainMap(nn.Module):
    """Cells of a picture (V, in_channels, h, w) -> (V, out_channels, h, w) float32."""

    def __init__(self, in_channels: int, width: int, out_channels: int):
        super().__init__()
        self.scale = nn.Parameter(torch.ones(in_channels))  # which make every channel's mean 0 and deviation 1
        self.offset = nn.Parameter(torch.zeros(in_channels))
        self.enter = nn.Conv2d(in_channels, width, 3, padding=1)
        self.context = Linear(2 * in_channels, width)
        self.look = nn.ModuleList(nn.Conv2d(width, width, 3, padding=d, dilation=d) for d in DILATIONS)
        self.leave = Float32Conv2d(width, out_channels, 1)
        self.forget()

    def forget(self) -> None:
        """Change nothing, as when untrained."""
        nn.init.zeros_(self.leave.weight)
        nn.init.zeros_(self.leave.bias)

    def standardise(self, cells: Tensor) -> None:
        """Choose `scale` and `offset` by the cells (N, in_channels, h, w) of many pictures."""
        deviation, mean = torch.std_mean(cells, (0, 2, 3))
        with torch.no_grad():
            self.scale.copy_(1 / deviation.clamp_min(1e-3))
            self.offset.copy_(-mean * self.scale)

    def forward(self, cells: Tensor) -> Tensor:
        x = (cells * self.scale[:, None, None] + self.offset[:, None, None]).clamp(-FARTHEST, FARTHEST)
        whole = torch.cat(torch.std_mean(x, (2, 3)), 1)
        x = F.silu(self.enter(x.to(self.enter.weight.dtype)) + self.context(whole)[..., None, None])
        for look in self.look:
            x = x + F.dropout2d(F.silu(look(x)), DROPPED, self.training)
        return self.leave(x)


def cell_side(height: int, width: int) -> int:
    """Pixels along a cell of a picture."""
    least, most = CELL
    side = least
    while side < most and 2 * side * CELLS <= max(height, width):
        side *= 2
    return side
