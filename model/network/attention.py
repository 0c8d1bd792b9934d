# SPDX-License-Identifier: GPL-3.0-or-later
"""The projections of the two attention layers, and QK-norm (docs/network.md 3, 7 and 8.2)."""
from __future__ import annotations

import torch
from torch import nn

from .norm import Linear, RMSNorm
from .rope import Rotation
from .softmax import KeysValues, attend_to_all
from .window import Window


class Attention(nn.Module):
    """Heads and QK-norm, which runs over all heads together, before they are split."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.out_proj = Linear(width, width, bias=False)
        self.q_norm = RMSNorm(width)
        self.k_norm = RMSNorm(width)

    def split(self, x: torch.Tensor, norm: RMSNorm | None = None, rotation: Rotation | None = None) -> torch.Tensor:
        """(..., D) -> (..., heads, head width) in the format of x, normalised and rotated in float32 before."""
        heads = (x if norm is None else norm(x)).unflatten(-1, (self.heads, -1))
        return (heads if rotation is None else rotation(heads)).to(x.dtype)

    def output(self, seen: torch.Tensor) -> torch.Tensor:
        """(heads, n, head width) -> (n, D)."""
        return self.out_proj(seen.transpose(0, 1).flatten(-2))


class SelfAttention(Attention):
    """Queries, keys and values of one sequence, from one projection."""

    def __init__(self, width: int, heads: int):
        super().__init__(width, heads)
        self.in_proj = Linear(width, 3 * width, bias=False)

    def queries(self, x: torch.Tensor, rotation: Rotation | None = None) -> torch.Tensor:
        """(..., D) -> (..., heads, head width)."""
        return self.split(self.in_proj(x, slice(0, x.shape[-1])), self.q_norm, rotation)

    def keys_values(self, x: torch.Tensor, rotation: Rotation | None = None) -> tuple[torch.Tensor, torch.Tensor]:
        """(..., D) -> keys and values, each (..., heads, head width)."""
        k, v = self.in_proj(x, slice(x.shape[-1], None)).chunk(2, dim=-1)
        return self.split(k, self.k_norm, rotation), self.split(v)

    def forward(self, x: torch.Tensor, rotation: Rotation, keys: KeysValues, window: Window,
                begin: int) -> torch.Tensor:
        """Rows begin, begin + 1, ... of a sequence, (n, D), see its `keys` through the window -> (n, D)."""
        return self.output(window.attend(self.queries(x, rotation).transpose(0, 1), keys, begin))


class CrossAttention(Attention):
    """Queries of one sequence, keys and values of another."""

    def __init__(self, width: int, heads: int):
        super().__init__(width, heads)
        self.q_proj = Linear(width, width, bias=False)
        self.k_proj = Linear(width, width, bias=False)
        self.v_proj = Linear(width, width, bias=False)

    def queries(self, x: torch.Tensor, rotation: Rotation) -> torch.Tensor:
        """(..., D) -> (..., heads, head width)."""
        return self.split(self.q_proj(x), self.q_norm, rotation)

    def keys_values(self, context: torch.Tensor, rotation: Rotation) -> tuple[torch.Tensor, torch.Tensor]:
        """(..., D) -> keys and values, each (..., heads, head width)."""
        return self.split(self.k_proj(context), self.k_norm, rotation), self.split(self.v_proj(context))

    def forward(self, x: torch.Tensor, rotation: Rotation, keys: KeysValues) -> torch.Tensor:
        """(n, D) -> (n, D): every row sees all keys."""
        return self.output(attend_to_all(self.queries(x, rotation).transpose(0, 1), keys))
