# SPDX-License-Identifier: GPL-3.0-or-later
"""SwiGLU feed-forward layer (docs/network.md 3)."""
from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from .norm import Linear


class SwiGLU(nn.Module):
    """w2(silu(w1 x) * w3 x), no biases."""

    def __init__(self, width: int, hidden: int):
        super().__init__()
        self.w1 = Linear(width, hidden, bias=False)
        self.w2 = Linear(hidden, width, bias=False)
        self.w3 = Linear(width, hidden, bias=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = x.to(self.w1.weight.dtype)
        gate = F.silu(self.w1(x), inplace=not torch.is_grad_enabled())
        return self.w2(gate * self.w3(x))
