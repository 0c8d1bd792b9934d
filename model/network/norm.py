# SPDX-License-Identifier: GPL-3.0-or-later
"""RMSNorm, and layers that decide the precision of their product (docs/network.md 3, 11)."""
from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F


class RMSNorm(nn.Module):
    """x / sqrt(mean(x^2) + eps) * weight over the last axis, computed and returned in float32."""

    def __init__(self, width: int, eps: float = 1e-6):
        super().__init__()
        self.weight = nn.Parameter(torch.ones(width))
        self.eps = eps

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x, weight = x.float(), self.weight.float()
        if x.device.type != "cpu":
            return F.rms_norm(x, x.shape[-1:], weight, self.eps)
        # For CPUs PyTorch has no kernel of it, and what it does instead takes twice as long as this.
        squares = torch.linalg.vector_norm(x, dim=-1, keepdim=True).square()
        return x * (squares / x.shape[-1] + self.eps).rsqrt() * weight


class Linear(nn.Linear):
    """nn.Linear that takes any input dtype, so that the residual stream may stay in float32 above bfloat16 weights."""

    def forward(self, x: torch.Tensor, outputs: slice = slice(None)) -> torch.Tensor:
        """(..., in) -> (..., out) in the weights' dtype, or some of the outputs."""
        bias = None if self.bias is None else self.bias[outputs]
        return F.linear(x.to(self.weight.dtype), self.weight[outputs], bias)


class Float32Conv2d(nn.Conv2d):
    """nn.Conv2d that stays in float32 when `in_precision` stores the others in half precision."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x.float())
