# SPDX-License-Identifier: GPL-3.0-or-later
"""Convolutions and resizes of tall maps in horizontal bands, with the numbers of the whole map.

A band takes the rows that its neighbours own instead of padding, and resizes by the whole map's coordinates. Rows that
two bands need are kept between them, so nothing is computed twice. For inference only.
"""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import nn
from torch.nn import functional as F

from ..progress import report


class Rows:
    """Rows of a (V, C, H, W) map, computed on demand. One reader asks for them, from top to bottom.

    `compute(begin, end)` returns rows begin..end - 1; the rows of the last reading are held until the next.
    """

    def __init__(self, size: tuple[int, int], compute: Callable[[int, int], torch.Tensor]):
        self.size, self.compute = size, compute
        self.begin = self.end = 0
        self.held: torch.Tensor | None = None

    def __call__(self, begin: int, end: int) -> torch.Tensor:
        """Rows begin..end - 1, those outside of the map left out."""
        begin, end = max(begin, 0), min(end, self.size[0])
        if begin >= self.end:
            rows = self.compute(begin, end)
        elif end > self.end:
            rows = torch.cat([self.held[:, :, begin - self.begin:], self.compute(self.end, end)], dim=2)
        else:
            rows = self.again(begin, self.end)
        self.begin, self.end, self.held = begin, max(end, self.end), rows
        report()
        return self.again(begin, end)

    def again(self, begin: int, end: int) -> torch.Tensor:
        """A part of what the reader has just been given."""
        return self.held[:, :, begin - self.begin:end - self.begin]


def whole(x: torch.Tensor) -> Rows:
    """A map that is already there."""
    return Rows(tuple(x.shape[-2:]), lambda begin, end: x[:, :, begin:end])


def convolved(conv: nn.Conv2d, source: Rows, activation=None) -> Rows:
    """conv(activation(source)) with zero padding outside of the map, in the format of the weights."""
    (side, _), (stride, _), (pad, _) = conv.kernel_size, conv.stride, conv.padding

    def compute(begin: int, end: int) -> torch.Tensor:
        first, last = begin * stride - pad, (end - 1) * stride - pad + side
        x = source(first, last)
        x = x if activation is None else activation(x)
        above, below = max(-first, 0), max(last - source.size[0], 0)
        if above or below:
            x = F.pad(x, (0, 0, above, below))
        return F.conv2d(x.to(conv.weight.dtype), conv.weight, conv.bias, stride, (0, pad))

    return Rows(tuple((n + 2 * pad - side) // stride + 1 for n in source.size), compute)


def enlarged(conv: nn.ConvTranspose2d, source: Rows) -> Rows:
    """A transposed convolution whose kernel is as large as its stride: every row comes from one row of the source."""
    stride = conv.stride[0]

    def compute(begin: int, end: int) -> torch.Tensor:
        first = begin // stride
        x = conv(source(first, -(-end // stride)))
        return x[:, :, begin - first * stride:end - first * stride]

    return Rows(tuple(stride * n for n in source.size), compute)


def resized(source: Rows, size: tuple[int, int]) -> Rows:
    """Bilinear with aligned corners."""
    if source.size == size:
        return source
    height = source.size[0]
    # float32, as the whole picture's resize computes them: float64 would move the samples by more than rounding.
    scale = torch.tensor(height - 1, dtype=torch.float32) / max(size[0] - 1, 1)

    def compute(begin: int, end: int) -> torch.Tensor:
        position = torch.arange(begin, end, dtype=torch.float32) * scale
        low = position.long().clamp(max=height - 1)
        high = (low + 1).clamp(max=height - 1)
        first = int(low[0])
        x = source(first, int(high[-1]) + 1)
        narrow = x.float()
        upper, lower = (narrow.index_select(2, (rows - first).to(x.device)) for rows in (low, high))
        tall = upper.lerp_(lower, (position - low)[:, None].to(x.device))
        return F.interpolate(tall, size=(end - begin, size[1]), mode="bilinear", align_corners=True).to(x.dtype)

    return Rows(size, compute)


def added(source: Rows, update: Rows) -> Rows:
    """source + update, where `update` is the one that reads `source` and needs the rows at its own place."""
    def compute(begin: int, end: int) -> torch.Tensor:
        change = update(begin, end)
        return source.again(begin, end) + change

    return Rows(source.size, compute)


def combined(a: Rows, b: Rows, function) -> Rows:
    """function(a, b) of two independent maps of one size."""
    return Rows(a.size, lambda begin, end: function(a(begin, end), b(begin, end)))
