# SPDX-License-Identifier: GPL-3.0-or-later
"""Convolutions and resizes of maps, whole or in horizontal bands with the numbers of the whole map.

Every function takes tensors (V, C, H, W), or `Rows` for a map that is too tall to be in memory, and returns the like.
A band takes the rows that its neighbours own instead of padding, and resizes by the whole map's coordinates. Rows that
two bands need are kept between them, so nothing is computed twice. Rows are for inference only.
"""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import nn
from torch.nn import functional as F

from ..progress import report, steps
from .layers import Conv2d


class Rows:
    """Rows of a (V, C, H, W) map, computed on demand for one reader, from top to bottom.

    `compute(begin, end)` returns rows begin..end - 1; the rows of the last reading are held until the next.
    """

    def __init__(self, size: tuple[int, int], compute: Callable[[int, int], torch.Tensor]):
        self.size, self.compute = size, compute
        self.begin = self.end = 0
        self.latest: torch.Tensor | None = None

    def __call__(self, begin: int, end: int) -> torch.Tensor:
        """Rows begin..end - 1, those outside of the map left out."""
        begin, end = max(begin, 0), min(end, self.size[0])
        if begin >= self.end:
            rows = self.compute(begin, end)
        elif end > self.end:
            rows = torch.cat([self.latest[:, :, begin - self.begin:], self.compute(self.end, end)], dim=2)
        else:
            rows = self.again(begin, self.end)
        self.begin, self.end, self.latest = begin, max(end, self.end), rows
        report()
        return self.again(begin, end)

    def again(self, begin: int, end: int) -> torch.Tensor:
        """A part of the latest reading."""
        return self.latest[:, :, begin - self.begin:end - self.begin]

    def tensor(self, count: int) -> torch.Tensor:
        """The whole map, computed `count` rows at a time; progress is reported, and may cancel."""
        result = None
        for begin in steps(range(0, self.size[0], count)):
            band = self(begin, begin + count)
            if result is None:
                result = band.new_empty(*band.shape[:2], *self.size)
            result[:, :, begin:begin + count] = band
        return result


Map = torch.Tensor | Rows


def as_rows(x: torch.Tensor) -> Rows:
    """A map that is in memory."""
    return Rows(size(x), lambda begin, end: x[:, :, begin:end])


def size(x: Map) -> tuple[int, int]:
    """Height and width."""
    return x.size if isinstance(x, Rows) else tuple(x.shape[-2:])


def convolve(conv: Conv2d, x: Map, activation: Callable | None = None) -> Map:
    """conv(activation(x)), whose padding is zeros outside of the map."""
    if not isinstance(x, Rows):
        report()
        return conv(x if activation is None else activation(x))
    (side, _), (stride, _), (pad, _) = conv.kernel_size, conv.stride, conv.padding

    def compute(begin: int, end: int) -> torch.Tensor:
        first, last = begin * stride - pad, (end - 1) * stride - pad + side
        band = x(first, last)
        band = band if activation is None else activation(band)
        above, below = max(-first, 0), max(last - x.size[0], 0)
        if above or below:
            band = F.pad(band, (0, 0, above, below))
        return conv(band, (0, pad))

    return Rows(tuple((n + 2 * pad - side) // stride + 1 for n in x.size), compute)


def enlarge(conv: nn.ConvTranspose2d, x: Map) -> Map:
    """A transposed convolution whose kernel is as large as its stride: every row comes from one row of x."""
    if not isinstance(x, Rows):
        return conv(x)
    stride = conv.stride[0]

    def compute(begin: int, end: int) -> torch.Tensor:
        first = begin // stride
        band = conv(x(first, -(-end // stride)))
        return band[:, :, begin - first * stride:end - first * stride]

    return Rows(tuple(stride * n for n in x.size), compute)


def resize(x: Map, target: tuple[int, int]) -> Map:
    """Bilinear with aligned corners, to that height and width."""
    if size(x) == target:
        return x
    if not isinstance(x, Rows):
        return F.interpolate(x, size=target, mode="bilinear", align_corners=True)
    height = x.size[0]
    # float32, as the whole map's resize computes them: float64 would move the samples by more than rounding.
    scale = torch.tensor(height - 1, dtype=torch.float32) / max(target[0] - 1, 1)

    def compute(begin: int, end: int) -> torch.Tensor:
        position = torch.arange(begin, end, dtype=torch.float32) * scale
        low = position.long().clamp(max=height - 1)
        high = (low + 1).clamp(max=height - 1)
        first = int(low[0])
        band = x(first, int(high[-1]) + 1)
        narrow = band.float()
        upper, lower = (narrow.index_select(2, (rows - first).to(band.device)) for rows in (low, high))
        tall = upper.lerp_(lower, (position - low)[:, None].to(band.device))
        return F.interpolate(tall, size=(end - begin, target[1]), mode="bilinear", align_corners=True).to(band.dtype)

    return Rows(target, compute)


def add_update(x: Map, function: Callable[[Map], Map]) -> Map:
    """x + function(x), whose rows need those of x around them."""
    update = function(x)
    if not isinstance(x, Rows):
        return x + update

    def compute(begin: int, end: int) -> torch.Tensor:
        change = update(begin, end)
        return x.again(begin, end) + change

    return Rows(x.size, compute)


def combine(function: Callable, a: Map, b: Map) -> Map:
    """function(a, b) of two independent maps of one size."""
    if not isinstance(a, Rows):
        return function(a, b)
    return Rows(a.size, lambda begin, end: function(a(begin, end), b(begin, end)))
