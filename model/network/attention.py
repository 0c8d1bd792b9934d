# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact attention over blocks of keys, and the projections of the two attention layers (spec/network.md 3 and 7).

No function here ever holds a score or mask matrix of the whole sequence. Heads come first: queries, keys and values are
(heads, length, head width).
"""
from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from typing import Callable

import torch
from torch import nn
from torch.nn import functional as F

from .memory import Progress, cuts, room
from .norm import Linear, RMSNorm
from .rope import rotate

SAFE_EXPONENT = 60.0  # exp of it, and of its negative, times the longest sequence, is far inside of float32


@dataclass
class Visible:
    """Keys and values (heads, n, head width) that some queries see; `bias` (queries, n) is 0 or -inf."""

    keys: torch.Tensor
    values: torch.Tensor
    bias: torch.Tensor | None = None


class KeysValues:
    """Keys and values of a token sequence: one block where PyTorch's own attention is used, else many.

    Those are contiguous each, because a CPU's matrix products copy other layouts.
    """

    def __init__(self, blocks: list[tuple[torch.Tensor, torch.Tensor]]):
        self.blocks = [Visible(*block) for block in blocks]
        self.ends = list(accumulate(block.keys.shape[1] for block in self.blocks))

    @classmethod
    def collect(cls, project: Callable, cuts: list[tuple[int, int]], progress: Progress) -> KeysValues:
        """project(begin, end) -> keys and values (n, heads, head width), once for each of the `cuts` of a sequence."""
        length, blocks, memory = cuts[-1][1], [], None
        for begin, end in cuts:
            progress(begin / length)
            parts = [part.transpose(0, 1) for part in project(begin, end)]
            if not fused(parts[0]):
                memory = memory or [room((length, *part.shape[::2]), part) for part in parts]
                parts = [rows[begin:end].view(part.shape).copy_(part) for rows, part in zip(memory, parts)]
            blocks.append(parts)
        return cls(blocks if memory else [[torch.cat(parts, dim=1) for parts in zip(*blocks)]])

    def __len__(self) -> int:
        return self.ends[-1]

    @property
    def bytes(self) -> int:
        return sum(x.numel() * x.itemsize for block in self.blocks for x in (block.keys, block.values))

    @cached_property
    def longest(self) -> torch.Tensor:
        """(heads, 1, 1) float32: the largest norm of a key."""
        return longest_key(self.blocks)

    def before(self, end: int) -> list[Visible]:
        """Tokens 0..end - 1 in their blocks."""
        count = bisect_right(self.ends, end)
        done = self.ends[count - 1] if count else 0
        return self.blocks[:count] + ([self.rows(done, end)] if end > done else [])

    def rows(self, begin: int, end: int) -> Visible:
        """Tokens begin..end - 1 as one block."""
        found = []
        for i in range(bisect_right(self.ends, begin), bisect_left(self.ends, end) + 1):
            block, first = self.blocks[i], self.ends[i - 1] if i else 0
            cut = slice(max(begin - first, 0), end - first)
            found.append((block.keys[:, cut], block.values[:, cut]))
        return Visible(*(x[0] if len(x) == 1 else torch.cat(x, dim=1) for x in zip(*found)))


def attend(q: torch.Tensor, visible: list[Visible], longest: torch.Tensor | None = None,
           progress: Progress = Progress()) -> torch.Tensor:
    """softmax(q k^T / sqrt(width) + bias) v over the keys of all blocks together. (heads, n, width) -> same.

    longest: (heads, 1, 1), at least the norm of every key; computed when not given.
    """
    if fused(q):
        keys, values = (torch.cat(x, dim=1) for x in ([b.keys for b in visible], [b.values for b in visible]))
        bias = [q.new_zeros(q.shape[1], b.keys.shape[1]) if b.bias is None else b.bias for b in visible]
        return F.scaled_dot_product_attention(q[None], keys[None], values[None], attn_mask=torch.cat(bias, dim=1))[0]
    # PyTorch's fused CPU kernel runs bfloat16 at the speed of float32 on processors without AMX; products of blocks
    # whose scores stay in the cache are three times as fast. Where no score can overflow (Cauchy-Schwarz), no running
    # maximum is needed.
    q = q * q.shape[-1] ** -0.5
    longest = longest_key(visible) if longest is None else longest
    bounded = bool((largest_norm(q) * longest).max() <= SAFE_EXPONENT)
    total = weight = top = None
    for i, block in enumerate(visible):
        progress(i / len(visible))
        scores = torch.bmm(q, block.keys.transpose(1, 2))
        if block.bias is not None:
            scores += block.bias
        if not bounded:
            scores, top, shrink = below_maximum(scores, top)
            if i:
                total, weight = total * shrink, weight * shrink
        seen, weights = torch.bmm(scores.exp_(), block.values), scores.sum(dim=-1, keepdim=True)
        total, weight = (total.add_(seen), weight.add_(weights)) if i else (seen.float(), weights.float())
    return total.div_(weight).to(q.dtype)


def attend_to_all(q: torch.Tensor, keys: KeysValues, progress: Progress = Progress()) -> torch.Tensor:
    """Every query sees every key. (heads, n, width) -> same."""
    if fused(q):
        whole = keys.rows(0, len(keys))
        return F.scaled_dot_product_attention(q[None], whole.keys[None], whole.values[None])[0]
    return attend(q, keys.blocks, keys.longest, progress)


def fused(q: torch.Tensor) -> bool:
    """Whether PyTorch's own attention is to be used: where gradients are wanted, and on a GPU."""
    return torch.is_grad_enabled() or q.device.type != "cpu"


def below_maximum(scores: torch.Tensor, top: torch.Tensor | None) -> tuple[torch.Tensor, ...]:
    """(scores - maximum so far, that maximum, what earlier sums are worth now); `top` is the maximum before."""
    now = scores.amax(dim=-1, keepdim=True)
    now = now if top is None else torch.maximum(now, top)
    return scores.sub_(now), now, None if top is None else (top.float() - now.float()).exp_()


def longest_key(visible: list[Visible]) -> torch.Tensor:
    """(heads, 1, 1) float32: the largest norm of a key."""
    return torch.stack([largest_norm(block.keys) for block in visible]).amax(dim=0)


def largest_norm(x: torch.Tensor) -> torch.Tensor:
    """(heads, n, width) -> (heads, 1, 1) float32: of a row."""
    return torch.linalg.vector_norm(x.float(), dim=-1).amax(dim=-1)[:, None, None]


class Window:
    """Query i sees key j iff |i - j| <= half or either is one of the first `sink` tokens; every key if half is None."""

    QUERIES = 256  # sorted queries that share one band of keys

    def __init__(self, length: int, sink: int, half: int | None, device: torch.device):
        self.length, self.half = length, half
        self.sink = length if half is None or length - sink <= half + 1 else sink
        self.cuts = cuts(0, self.sink, device) + cuts(self.sink, length, device)
        self.biases: dict[tuple[int, int, int], torch.Tensor] = {}  # all interior blocks share one

    def attend(self, q: torch.Tensor, begin: int, keys: KeysValues, progress: Progress = Progress()) -> torch.Tensor:
        """Queries begin, begin + 1, ... of one of the `cuts`. (heads, n, width) -> same."""
        if begin < self.sink:
            return attend_to_all(q, keys, progress)
        seen = []
        for first in range(0, q.shape[1], self.QUERIES):
            progress(first / q.shape[1])
            part = q[:, first:first + self.QUERIES]
            band = self.band(begin + first, begin + first + part.shape[1], keys)
            seen.append(attend(part, [*keys.before(self.sink), band], keys.longest))
        return torch.cat(seen, dim=1)

    def band(self, begin: int, end: int, keys: KeysValues) -> Visible:
        """What sorted queries begin..end - 1 see beyond the sink."""
        low, high = max(begin - self.half, self.sink), min(end + self.half, self.length)
        band, place = keys.rows(low, high), (begin - low, end - low, high - low)
        if place not in self.biases:
            self.biases[place] = band_bias(*place, self.half, band.keys)
        return replace(band, bias=self.biases[place])


def band_bias(begin: int, end: int, keys: int, half: int, like: torch.Tensor) -> torch.Tensor:
    """(end - begin, keys): 0 where query begin + i and key j are at most `half` apart, else -inf."""
    query = torch.arange(begin, end, device=like.device)[:, None]
    distance = (query - torch.arange(keys, device=like.device)).abs()
    return torch.zeros(distance.shape, dtype=like.dtype, device=like.device).masked_fill_(distance > half, -torch.inf)


class Attention(nn.Module):
    """Heads and QK-norm, which runs over all heads together, before they are split."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.out_proj = Linear(width, width, bias=False)
        self.q_norm = RMSNorm(width)
        self.k_norm = RMSNorm(width)

    def split(self, x: torch.Tensor, norm: RMSNorm | None = None, rotation=None) -> torch.Tensor:
        """(..., D) -> (..., heads, head width) in the format of x, normalised and rotated in float32 before."""
        heads = (x if norm is None else norm(x)).unflatten(-1, (self.heads, -1))
        return (heads if rotation is None else rotate(heads, *rotation)).to(x.dtype)

    def output(self, seen: torch.Tensor) -> torch.Tensor:
        """(heads, n, head width) -> (n, D)."""
        return self.out_proj(seen.transpose(0, 1).flatten(-2))


class SelfAttention(Attention):
    """Queries, keys and values of one sequence, from one projection."""

    def __init__(self, width: int, heads: int):
        super().__init__(width, heads)
        self.in_proj = Linear(width, 3 * width, bias=False)

    def queries(self, x: torch.Tensor, rotation=None) -> torch.Tensor:
        """(..., D) -> (..., heads, head width); `rotation` is RotaryEmbedding's result."""
        return self.split(self.in_proj(x, slice(0, x.shape[-1])), self.q_norm, rotation)

    def keys_values(self, x: torch.Tensor, rotation=None) -> tuple[torch.Tensor, torch.Tensor]:
        """(..., D) -> keys and values, each (..., heads, head width)."""
        k, v = self.in_proj(x, slice(x.shape[-1], None)).chunk(2, dim=-1)
        return self.split(k, self.k_norm, rotation), self.split(v)


class CrossAttention(Attention):
    """Queries of one sequence, keys and values of another."""

    def __init__(self, width: int, heads: int):
        super().__init__(width, heads)
        self.q_proj = Linear(width, width, bias=False)
        self.k_proj = Linear(width, width, bias=False)
        self.v_proj = Linear(width, width, bias=False)

    def queries(self, x: torch.Tensor, rotation) -> torch.Tensor:
        """(..., D) -> (..., heads, head width)."""
        return self.split(self.q_proj(x), self.q_norm, rotation)

    def keys_values(self, context: torch.Tensor, rotation) -> tuple[torch.Tensor, torch.Tensor]:
        """(..., D) -> keys and values, each (..., heads, head width)."""
        return self.split(self.k_proj(context), self.k_norm, rotation), self.split(self.v_proj(context))
