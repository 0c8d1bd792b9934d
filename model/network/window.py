# SPDX-License-Identifier: GPL-3.0-or-later
"""The window + sink mask of stage 1 (docs/network.md 7)."""
from __future__ import annotations

from dataclasses import replace

import torch
from torch.nn import functional as F

from ..progress import part
from .memory import cuts, divided
from .softmax import KeysValues, Visible, attend, attend_to_all, fused


class Window:
    """Query i sees key j iff |i - j| <= half or either is one of the first `sink` tokens; every key if half is None."""

    QUERIES = 256  # sorted queries that share one band of keys
    TOGETHER = 16  # such bands that PyTorch's own attention is given at once

    def __init__(self, length: int, sink: int, half: int | None, device: torch.device):
        self.length, self.half = length, half
        self.sink = length if half is None or length - sink <= half + 1 else sink
        self.pieces = cuts(0, self.sink, device) + cuts(self.sink, length, device)
        self.biases: dict[tuple[int, int, int], torch.Tensor] = {}  # all interior blocks share one

    def attend(self, q: torch.Tensor, keys: KeysValues, begin: int) -> torch.Tensor:
        """Queries begin, begin + 1, ... of one of the `pieces`. (heads, n, width) -> same."""
        if begin < self.sink:
            return attend_to_all(q, keys)
        if fused(q):
            size = self.QUERIES * divided(self.TOGETHER)
            return torch.cat([self.bands(some, keys, begin + i * size)
                              for i, some in enumerate(q.split(size, dim=1))], dim=1)
        seen = []
        for first in range(0, q.shape[1], self.QUERIES):
            some = q[:, first:first + self.QUERIES]
            band = self.band(begin + first, begin + first + some.shape[1], keys)
            with part(first / q.shape[1], (first + some.shape[1]) / q.shape[1]):
                seen.append(attend(some, [*keys.before(self.sink), band], keys.longest))
        return torch.cat(seen, dim=1)

    def bands(self, q: torch.Tensor, keys: KeysValues, begin: int) -> torch.Tensor:
        """Sorted queries begin, begin + 1, ..., (heads, n, width) -> same: in one call, and no card is waited for."""
        n, device = q.shape[1], q.device
        blocks = -(-n // self.QUERIES)
        q = F.pad(q, (0, 0, 0, blocks * self.QUERIES - n)).unflatten(1, (blocks, self.QUERIES)).transpose(0, 1)
        query = torch.arange(begin, begin + blocks * self.QUERIES, device=device).view(blocks, self.QUERIES, 1)
        key = query[:, :1, 0] - self.half + torch.arange(self.QUERIES + 2 * self.half, device=device)
        there = (key >= self.sink) & (key < self.length)
        seen = ((query - key[:, None]).abs() <= self.half) & there[:, None]
        seen = torch.cat([seen.new_ones(blocks, self.QUERIES, self.sink), seen], dim=2)
        whole, place = keys.rows(0, self.length), key.clamp(0, self.length - 1)
        pair = (torch.cat([x[:, :self.sink].expand(blocks, -1, -1, -1), x[:, place].transpose(0, 1)], dim=2)
                for x in (whole.keys, whole.values))
        found = F.scaled_dot_product_attention(q, *pair, attn_mask=seen[:, None])
        return found.transpose(0, 1).flatten(1, 2)[:, :n]

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
