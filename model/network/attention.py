# SPDX-License-Identifier: GPL-3.0-or-later
"""Attention layers: projections, heads and QK-norm of both stages, and the shifted windows of ray tokens
(docs/network.md 3, 7 and 8).
"""
from __future__ import annotations

from functools import lru_cache

import torch
from torch import nn
from torch.nn import functional as F

from ..compute.inference import chunked, current_pieces, is_inference
from .block_attention import KeysValues, Window, attend_to_all
from .config import SWIN_WINDOW
from .layers import Linear, RMSNorm, Rotation

WINDOW = SWIN_WINDOW
SHIFT = 4
TOKENS = 8192   # of a band of windows: bounds the copies made to shift and partition
WINDOWS = 32    # attended to together, for short polls; a card takes as many as its memory is enough for


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

    def output(self, heads: torch.Tensor) -> torch.Tensor:
        """(heads, n, head width) -> (n, D)."""
        return self.out_proj(heads.transpose(0, 1).flatten(-2))


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
    """Queries of one sequence, keys and values of another.

    `dtype`: that these are multiplied in; None for that of the projections' results.
    """

    dtype: torch.dtype | None = None

    def __init__(self, width: int, heads: int):
        super().__init__(width, heads)
        self.q_proj = Linear(width, width, bias=False)
        self.k_proj = Linear(width, width, bias=False)
        self.v_proj = Linear(width, width, bias=False)

    def split(self, x: torch.Tensor, norm: RMSNorm | None = None, rotation: Rotation | None = None) -> torch.Tensor:
        """As every attention's, rounded to `dtype` at last."""
        heads = super().split(x, norm, rotation)
        return heads if self.dtype is None else heads.to(self.dtype)

    def queries(self, x: torch.Tensor, rotation: Rotation) -> torch.Tensor:
        """(..., D) -> (..., heads, head width)."""
        return self.split(self.q_proj(x), self.q_norm, rotation)

    def keys_values(self, context: torch.Tensor, rotation: Rotation) -> tuple[torch.Tensor, torch.Tensor]:
        """(..., D) -> keys and values, each (..., heads, head width)."""
        return self.split(self.k_proj(context), self.k_norm, rotation), self.split(self.v_proj(context))

    def forward(self, x: torch.Tensor, rotation: Rotation, keys: KeysValues) -> torch.Tensor:
        """(n, D) -> (n, D): every row sees all keys."""
        return self.output(attend_to_all(self.queries(x, rotation).transpose(0, 1), keys))


def to_windows(x: torch.Tensor) -> torch.Tensor:
    """(V, Hg, Wg, ...) -> (V Hg Wg / 64, 64, ...), windows and their tokens row-major."""
    x = x.unflatten(2, (-1, WINDOW)).unflatten(1, (-1, WINDOW)).transpose(2, 3)
    return x.flatten(3, 4).flatten(0, 2) if x.dim() == 5 else x.flatten(0, 2).flatten(1, 2)


def from_windows(windows: torch.Tensor, grid: tuple[int, int]) -> torch.Tensor:
    """Inverse of `to_windows`: (B, 64, D) -> (V, Hg, Wg, D)."""
    rows, columns = grid[0] // WINDOW, grid[1] // WINDOW
    x = windows.view(-1, rows, columns, WINDOW, WINDOW, windows.shape[-1])
    return x.transpose(2, 3).reshape(-1, *grid, windows.shape[-1])


@lru_cache(maxsize=8)
def shift_mask(grid: tuple[int, int], device: torch.device | None = None) -> torch.Tensor:
    """(windows, 64, 64) bool: which tokens of a rolled grid were neighbours before the roll."""
    places = [torch.arange(side, device=device) for side in grid]
    rows, columns = (place.ge(len(place) - WINDOW).long() + place.ge(len(place) - SHIFT).long() for place in places)
    region = to_windows((3 * rows[:, None] + columns)[None, :, :, None])[..., 0]
    return region[:, :, None] == region[:, None, :]


class SwinAttention(SelfAttention):
    """Self-attention in 8x8 windows, shifted by 4 tokens in every other layer; no positional term."""

    def __init__(self, width: int, heads: int, shifted: bool):
        super().__init__(width, heads)
        self.shifted = shifted

    def forward(self, x: torch.Tensor, norm: nn.Module) -> torch.Tensor:
        """(V, Hg, Wg, D), normalised by `norm` window by window -> (V, Hg, Wg, D)."""
        views, height, width = x.shape[:3]
        shift = SHIFT if self.shifted else 0
        rows, together, result = height, 0, None
        if is_inference():
            tokens, attended = (current_pieces().sequence_rows(x.device, usual)
                                for usual in (TOKENS, WINDOWS * WINDOW ** 2))
            rows = WINDOW * max(1, tokens // (WINDOW * width * views))
            together = max(1, attended // WINDOW ** 2)
        for begin in range(0, height, rows):
            end = min(begin + rows, height)
            lines = (torch.arange(begin, end, device=x.device) + shift) % height
            inputs = [to_windows(x.index_select(1, lines).roll(-shift, dims=2))]
            if shift:
                mask = shift_mask((height, width), x.device).unflatten(0, (height // WINDOW, -1))
                inputs.append(mask[begin // WINDOW:end // WINDOW].flatten(0, 1).repeat(views, 1, 1))
            windows = chunked(lambda x, *mask: self._attend(norm(x), *mask), *inputs, size=together)
            band = from_windows(windows, (end - begin, width)).roll(shift, dims=2)
            if result is None:
                result = band.new_empty(views, height, *band.shape[2:])
            result.index_copy_(1, lines, band)
        return result

    def _attend(self, x: torch.Tensor, mask: torch.Tensor | None = None) -> torch.Tensor:
        q, k, v = (heads.transpose(1, 2) for heads in (self.queries(x), *self.keys_values(x)))
        heads = F.scaled_dot_product_attention(q, k, v, attn_mask=None if mask is None else mask[:, None])
        return self.out_proj(heads.transpose(1, 2).flatten(2))
