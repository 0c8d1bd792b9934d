# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact attention over blocks of keys, and the window + sink mask of stage 1 (docs/network.md 3 and 7).

No function here ever holds a score or mask matrix of the whole sequence. Heads come first: queries, keys and values are
(heads, length, head width).
"""
from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

import torch
from torch.nn import functional as F

from ..compute.inference import current_pieces, cuts, is_inference, room
from ..compute.threads import Once, shared
from ..progress import report, standing_still
from .attention_with_lse import attention_with_lse, has_kernels, merged

SAFE_EXPONENT = 60.0  # exp of it, and of its negative, times the longest sequence, is far inside of float32


@dataclass
class Visible:
    """Keys and values (heads, n, head width) that some queries see; `bias` (queries, n) is 0 or -inf."""

    keys: torch.Tensor
    values: torch.Tensor
    bias: torch.Tensor | None = None


class KeysValues:
    """Keys and values of a token sequence: one block where PyTorch's own attention is used, else many.

    Each of many is contiguous, because a CPU's matrix products copy other layouts.
    """

    def __init__(self, blocks: list[tuple[torch.Tensor, torch.Tensor]]):
        self.blocks = [Visible(*block) for block in blocks]
        self.ends = list(accumulate(block.keys.shape[1] for block in self.blocks))

    @classmethod
    def collect(cls, project: Callable, pieces: list[slice], device: torch.device) -> KeysValues:
        """project(rows) -> keys and values (n, heads, head width), once for each of the pieces of a sequence."""
        length, memory = pieces[-1].stop, Once()

        def block(rows: slice) -> list[torch.Tensor]:
            pair = [x.transpose(0, 1) for x in project(rows)]
            if uses_fused_attention(pair[0]):
                return pair
            rooms = memory.get(lambda: [room((length, *x.shape[::2]), x) for x in pair])
            return [whole[rows].view(x.shape).copy_(x) for whole, x in zip(rooms, pair)]

        with standing_still():
            blocks = shared(block, pieces, device=device)
        if uses_fused_attention(blocks[0][0]):
            blocks = [[torch.cat(parts, dim=1) for parts in zip(*blocks)]]
        return cls(blocks)

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
        covered = self.ends[count - 1] if count else 0
        return self.blocks[:count] + ([self.rows(covered, end)] if end > covered else [])

    def rows(self, begin: int, end: int) -> Visible:
        """Tokens begin..end - 1 as one block."""
        parts = []
        for i in range(bisect_right(self.ends, begin), bisect_left(self.ends, end) + 1):
            block, first = self.blocks[i], self.ends[i - 1] if i else 0
            cut = slice(max(begin - first, 0), end - first)
            parts.append((block.keys[:, cut], block.values[:, cut]))
        return Visible(*(x[0] if len(x) == 1 else torch.cat(x, dim=1) for x in zip(*parts)))


def attend(q: torch.Tensor, visible: list[Visible], longest: torch.Tensor | None = None) -> torch.Tensor:
    """softmax(q k^T / sqrt(width) + bias) v over the keys of all blocks together. (heads, n, width) -> same.

    longest: (heads, 1, 1), at least the norm of every key; computed when not given. Where PyTorch's own attention is
    used, q may be (several, heads, n, width), and so may be some of the blocks.
    """
    if uses_fused_attention(q):
        several = q if q.ndim == 4 else q[None]
        keys, values = (torch.cat([x.expand(*several.shape[:2], *x.shape[-2:]) for x in blocks], dim=2)
                        for blocks in ([b.keys for b in visible], [b.values for b in visible]))
        biases = [q.new_zeros(q.shape[-2], b.keys.shape[-2]) if b.bias is None else b.bias for b in visible]
        leading = max((b.shape[:-2] for b in biases), key=len)
        mask = torch.cat([b.expand(*leading, *b.shape[-2:]) for b in biases], dim=-1)
        result = F.scaled_dot_product_attention(several, keys, values, attn_mask=mask)
        return result if q.ndim == 4 else result[0]
    # PyTorch's fused CPU kernel runs bfloat16 at the speed of float32 on processors without AMX; products of blocks
    # whose scores stay in the cache are three times as fast. Where no score can overflow (Cauchy-Schwarz), no running
    # maximum is needed.
    q = q * q.shape[-1] ** -0.5
    longest = longest_key(visible) if longest is None else longest
    bounded = bool((largest_norm(q) * longest).max() <= SAFE_EXPONENT)
    total = weight = top = None
    for i, block in enumerate(visible):
        report()
        scores = torch.bmm(q, block.keys.transpose(1, 2))
        if block.bias is not None:
            scores += block.bias
        if not bounded:
            scores, top, shrink = below_maximum(scores, top)
            if i:
                total, weight = total * shrink, weight * shrink
        sums, weights = torch.bmm(scores.exp_(), block.values), scores.sum(dim=-1, keepdim=True)
        total, weight = (total.add_(sums), weight.add_(weights)) if i else (sums.float(), weights.float())
    return total.div_(weight).to(q.dtype)


def attend_to_all(q: torch.Tensor, keys: KeysValues) -> torch.Tensor:
    """Every query sees every key. (heads, n, width) -> same."""
    if uses_fused_attention(q):
        block = keys.rows(0, len(keys))
        return F.scaled_dot_product_attention(q[None], block.keys[None], block.values[None])[0]
    return attend(q, keys.blocks, keys.longest)


def uses_fused_attention(q: torch.Tensor) -> bool:
    """Whether PyTorch's own attention is used: in training, and on a GPU."""
    return not is_inference() or q.device.type != "cpu"


def below_maximum(scores: torch.Tensor, top: torch.Tensor | None) -> tuple[torch.Tensor, ...]:
    """(scores - maximum so far, that maximum, factor of earlier sums); `top` is the maximum before."""
    maximum = scores.amax(dim=-1, keepdim=True)
    maximum = maximum if top is None else torch.maximum(maximum, top)
    return scores.sub_(maximum), maximum, None if top is None else (top.float() - maximum.float()).exp_()


def longest_key(visible: list[Visible]) -> torch.Tensor:
    """(heads, 1, 1) float32: the largest norm of a key."""
    return torch.stack([largest_norm(block.keys) for block in visible]).amax(dim=0)


def largest_norm(x: torch.Tensor) -> torch.Tensor:
    """(heads, n, width) -> (heads, 1, 1) float32: of a row."""
    return torch.linalg.vector_norm(x.float(), dim=-1).amax(dim=-1)[:, None, None]


class Window:
    """Query i sees key j iff |i - j| <= half or either is one of the first `sink` tokens; every key if half is None."""

    QUERIES = 256  # sorted queries that share one band of keys
    TOGETHER = 16  # such bands in one call in training; a processor's caches hold the scores of one

    def __init__(self, length: int, sink: int, half: int | None, device: torch.device):
        self.length, self.half = length, half
        self.sink = length if half is None or length - sink <= half + 1 else sink
        self.pieces = cuts(0, self.sink, device) + cuts(self.sink, length, device)
        self.biases: dict[tuple[int, ...], torch.Tensor] = {}  # bands in the interior share one

    def attend(self, q: torch.Tensor, keys: KeysValues, begin: int) -> torch.Tensor:
        """Queries begin, begin + 1, ... of one of the `pieces`, (heads, n, width) -> same."""
        if begin < self.sink:
            return attend_to_all(q, keys)
        if is_inference() and has_kernels(q.device):
            return self._attend_twice(q, keys, begin)
        count = self.QUERIES * (current_pieces().limit(self.TOGETHER) if uses_fused_attention(q) else 1)
        return torch.cat([self._attend_in_bands(q[:, first:first + count], keys, begin + first)
                          for first in range(0, q.shape[1], count)], dim=1)

    def _attend_in_bands(self, q: torch.Tensor, keys: KeysValues, begin: int) -> torch.Tensor:
        """Sorted queries begin, begin + 1, ..., (heads, n, width) -> same: several bands at once, and no card waits."""
        n, sink = q.shape[1], keys.before(self.sink)
        rows, count = min(n, self.QUERIES), -(-n // self.QUERIES)
        band = self._visible_band(begin, rows, count, keys)
        if count == 1:
            return attend(q, [*sink, band], None if uses_fused_attention(q) else keys.longest)
        q = F.pad(q, (0, 0, 0, count * rows - n)).unflatten(1, (count, rows)).transpose(0, 1)
        return attend(q, [*sink, band]).transpose(0, 1).flatten(1, 2)[:, :n]

    def _attend_twice(self, q: torch.Tensor, keys: KeysValues, begin: int) -> torch.Tensor:
        """The same as `_attend_in_bands`, sink and band by themselves: no keys are copied, and the sink has no mask."""
        band = self._attend_to_band(q, keys, begin)
        if not self.sink:
            return band[0]
        sink = keys.rows(0, self.sink)
        output, lse = attention_with_lse(q[None], sink.keys[None], sink.values[None])
        return merged((output[0], lse[0]), band)

    def _attend_to_band(self, q: torch.Tensor, keys: KeysValues, begin: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Sorted queries begin, begin + 1, ..., (heads, n, width), without the sink -> the same, and log-sum-exp
        (heads, n) float32."""
        n = q.shape[1]
        rows = min(n, self.QUERIES)
        count = -(-n // rows)
        # Bands that are cut off at an end have masks of their own and copies of keys; all others share one mask.
        inner = min(max(-(-(self.sink + self.half - begin) // rows), 0), count)
        outer = min(max((self.length - self.half - begin) // rows, inner), count)
        q = F.pad(q, (0, 0, 0, count * rows - n)).unflatten(1, (count, rows)).transpose(0, 1)
        parts = []
        for first, last in pairwise((0, inner, outer, count)):
            if first < last:
                band = self._visible_band(begin + first * rows, rows, last - first, keys)
                pair = (x if x.ndim == 4 else x[None] for x in (band.keys, band.values))
                parts.append(attention_with_lse(q[first:last], *pair, band.bias))
        output, lse = (torch.cat(x).transpose(0, 1).flatten(1, 2)[:, :n] for x in zip(*parts))
        return output, lse

    def _visible_band(self, begin: int, rows: int, count: int, keys: KeysValues) -> Visible:
        """What `count` times `rows` sorted queries from `begin` on see beyond the sink.

        Keys and values are (heads, m, width) for a `count` of 1, else (count, heads, m, width).
        """
        low, high = begin - self.half, begin + rows * count + self.half
        before, after = max(self.sink - low, 0), max(high - self.length, 0)
        block = keys.rows(low + before, high - after)
        pair = [F.pad(x, (0, 0, before, after)) if before or after else x for x in (block.keys, block.values)]
        if count > 1:
            pair = [x.unfold(1, rows + 2 * self.half, rows).permute(1, 0, 3, 2) for x in pair]
        layout = rows, count, before, after
        if layout not in self.biases:
            self.biases[layout] = band_bias(*layout, self.half, block.keys)
        return Visible(*pair, self.biases[layout])


def band_bias(rows: int, count: int, before: int, after: int, half: int, like: torch.Tensor) -> torch.Tensor:
    """0 where query i and key j of a band are at most `half` apart, else -inf: (rows, rows + 2 half) where that is the
    same for all, (count, 1, rows, rows + 2 half) where the first `before` and the last `after` keys are padding."""
    key = torch.arange(rows + 2 * half, device=like.device)
    hidden = (torch.arange(rows, device=like.device)[:, None] + half - key).abs() > half
    if before or after:
        position = key + rows * torch.arange(count, device=like.device)[:, None]
        padding = (position < before) | (position >= rows * count + 2 * half - after)
        hidden = (hidden | padding[:, None])[:, None] if count > 1 else hidden | padding
    return torch.zeros(hidden.shape, dtype=like.dtype, device=like.device).masked_fill_(hidden, -torch.inf)
