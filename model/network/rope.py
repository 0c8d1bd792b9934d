# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotary position embedding of 3-D points (docs/network.md 6)."""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F


def rope_frequencies(dim: int) -> torch.Tensor:
    """(dim / 2,) float32 frequencies, log-spaced from 1 to dim / 2 - 1."""
    count = dim // 2
    return torch.tensor(2.0 ** (np.arange(count) * (math.log2(count - 1) / (count - 1))), dtype=torch.float32)


@dataclass
class Rotation:
    """Angles of n tokens, the same for all heads; an index takes some of the tokens."""

    cos: torch.Tensor  # (n, 1, head width / 2) float32
    sin: torch.Tensor  # same

    def __getitem__(self, rows: slice) -> Rotation:
        return Rotation(self.cos[rows], self.sin[rows])

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """Turn channel pairs (j, j + width / 2) of (n, heads, width) float32."""
        a, b = x.chunk(2, dim=-1)
        return torch.cat([torch.addcmul(a * self.cos, b, self.sin, value=-1),
                          torch.addcmul(b * self.cos, a, self.sin)], dim=-1)


class RotaryEmbedding(nn.Module):
    """Angles from positions; the frequencies belong to the checkpoint but are never trained or rounded."""

    def __init__(self, dim: int, head_width: int):
        super().__init__()
        self.freqs = nn.Parameter(rope_frequencies(dim), requires_grad=False)
        self.idle = head_width // 2 - 3 * (dim // 2)

    def _apply(self, fn, recurse=True):
        # Module.to(bfloat16) must move the frequencies but not round them.
        exact = self.freqs.data
        super()._apply(fn, recurse)
        if self.freqs.dtype != exact.dtype:
            self.freqs.data = exact.to(self.freqs.device)
        return self

    def forward(self, positions: torch.Tensor) -> Rotation:
        """(..., 3) positions -> the rotation of tokens there."""
        angles = (positions.float()[..., None] * self.freqs.float()).flatten(-2)
        angles = F.pad(angles, (0, self.idle))[..., None, :]
        return Rotation(angles.cos(), angles.sin())
