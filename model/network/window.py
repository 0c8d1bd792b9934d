# SPDX-License-Identifier: GPL-3.0-or-later
"""The window + sink mask of stage 1 (docs/network.md 7)."""
from __future__ import annotations

import torch
from torch.nn import functional as F

from ..progress import part
from .memory import cuts, divided
from .softmax import KeysValues, Visible, attend, attend_to_all, fused


class Window:
    """Query i sees key j iff |i - j| <= half or either is one of the first `sink` tokens; every key if half is None."""

    QUERIES = 256  # sorted queries that share one band of keys
    TOGETHER = 16  # such bands in one call on a card; a processor's caches hold the scores of one

    def __init__(self, length: int, sink: int, half: int | None, device: torch.device):
        self.length, self.half = length, half
        self.sink = length if half is None or length - sink <= half + 1 else sink
        self.pieces = cuts(0, self.sink, device) + cuts(self.sink, length, device)
        self.biases: dict[tuple[int, ...], torch.Tensor] = {}  # those of all bands in the interior are one

    def attend(self, q: torch.Tensor, keys: KeysValues, begin: int) -> torch.Tensor:
        """Queries begin, begin + 1, ... of one of the `pieces`. (heads, n, width) -> same."""
        if begin < self.sink:
            return attend_to_all(q, keys)
        size, n, seen = self.QUERIES * (divided(self.TOGETHER) if fused(q) else 1), q.shape[1], []
        for first in range(0, n, size):
            with part(first / n, min(first + size, n) / n):
                seen.append(self.bands(q[:, first:first + size], keys, begin + first))
        return torch.cat(seen, dim=1)

    def bands(self, q: torch.Tensor, keys: KeysValues, begin: int) -> torch.Tensor:
        """Sorted queries begin, begin + 1, ..., (heads, n, width) -> same: some bands at once, no card waits."""
        n, sink = q.shape[1], keys.before(self.sink)
        rows, count = min(n, self.QUERIES), -(-n // self.QUERIES)
        band = self.band(begin, rows, count, keys)
        if count == 1:
            return attend(q, [*sink, band], None if fused(q) else keys.longest)
        q = F.pad(q, (0, 0, 0, count * rows - n)).unflatten(1, (count, rows)).transpose(0, 1)
        return attend(q, [*sink, band]).transpose(0, 1).flatten(1, 2)[:, :n]

    def band(self, begin: int, rows: int, count: int, keys: KeysValues) -> Visible:
        """What `count` times `rows` sorted queries from `begin` on see beyond the sink.

        Keys and values are (heads, m, width) for one time, else (count, heads, m, width).
        """
        low, high = begin - self.half, begin + rows * count + self.half
        before, after = max(self.sink - low, 0), max(high - self.length, 0)
        whole = keys.rows(low + before, high - after)
        pair = [F.pad(x, (0, 0, before, after)) if before or after else x for x in (whole.keys, whole.values)]
        if count > 1:
            pair = [x.unfold(1, rows + 2 * self.half, rows).permute(1, 0, 3, 2) for x in pair]
        place = rows, count, before, after
        if place not in self.biases:
            self.biases[place] = band_bias(*place, self.half, whole.keys)
        return Visible(*pair, self.biases[place])


def band_bias(rows: int, count: int, before: int, after: int, half: int, like: torch.Tensor) -> torch.Tensor:
    """0 where query i and key j of a band are at most `half` apart, else -inf: (rows, rows + 2 half) where that is the
    same for all, (count, 1, rows, rows + 2 half) where the first `before` and the last `after` keys are none."""
    key = torch.arange(rows + 2 * half, device=like.device)
    unseen = (torch.arange(rows, device=like.device)[:, None] + half - key).abs() > half
    if before or after:
        place = key + rows * torch.arange(count, device=like.device)[:, None]
        none = (place < before) | (place >= rows * count + 2 * half - after)
        unseen = (unseen | none[:, None])[:, None] if count > 1 else unseen | none
    return torch.zeros(unseen.shape, dtype=like.dtype, device=like.device).masked_fill_(unseen, -torch.inf)
