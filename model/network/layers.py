# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers that both stages are built of: norms and products that decide their precision, encodings of vectors and
positions, and the feed-forward layer (docs/network.md 3, 6, 11).
"""
from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from ..compute.precision import exact_float_32


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


class Conv2d(nn.Conv2d):
    """nn.Conv2d that takes any input dtype, and another padding for a part of a map."""

    def forward(self, x: torch.Tensor, padding: tuple[int, int] | None = None) -> torch.Tensor:
        padding = self.padding if padding is None else padding
        return F.conv2d(x.to(self.weight.dtype), self.weight, self.bias, self.stride, padding, self.dilation,
                        self.groups)


class Float32Conv2d(Conv2d):
    """Conv2d that stays in float32 when `in_precision` stores the others in half precision, with all its bits: cards
    compute other convolutions of float32 in TensorFloat-32."""

    def forward(self, x: torch.Tensor, padding: tuple[int, int] | None = None) -> torch.Tensor:
        with exact_float_32():
            return super().forward(x, padding)


def learned_token(count: int, width: int) -> nn.Parameter:
    """(1, count, width) tokens to be learned."""
    token = torch.empty(1, count, width)
    # For random numbers on the meta device PyTorch would import its compiler, which takes a second.
    return nn.Parameter(token if token.is_meta else token.normal_(std=0.02))


def nerf_encode(x: torch.Tensor, octaves: int) -> torch.Tensor:
    """(..., c) -> (..., c + 2 c octaves) float32: the inputs, all sines, all cosines; frequencies 2^k without pi."""
    x = x.float()
    if octaves == 0:
        return x
    frequencies = 2.0 ** torch.arange(octaves, device=x.device, dtype=torch.float32)
    phase = (x[..., None] * frequencies).flatten(-2)
    return torch.cat([x, phase.sin(), (phase + math.pi / 2).sin()], dim=-1)


def nerf_width(channels: int, octaves: int) -> int:
    """Width of `nerf_encode`'s result."""
    return channels * (1 + 2 * octaves)


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
        """(..., 3) positions -> the rotation of tokens at them."""
        angles = (positions.float()[..., None] * self.freqs.float()).flatten(-2)
        angles = F.pad(angles, (0, self.idle))[..., None, :]
        return Rotation(angles.cos(), angles.sin())


class SwiGLU(nn.Module):
    """w2(silu(w1 x) * w3 x), no biases."""

    def __init__(self, width: int, hidden: int):
        super().__init__()
        self.w1 = Linear(width, hidden, bias=False)
        self.w2 = Linear(hidden, width, bias=False)
        self.w3 = Linear(width, hidden, bias=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = x.to(self.w1.weight.dtype)
        return self.w2(F.silu(self.w1(x)) * self.w3(x))


def in_precision(model: nn.Module, dtype: torch.dtype, exact: Iterable[nn.Module] = ()) -> nn.Module:
    """Store the weights of matrix products and convolutions in `dtype`; norms, tokens and last layer stay float32.

    exact: parts of the model that stay as they are.
    """
    for module in set(model.modules()) - {module for part in exact for module in part.modules()}:
        if isinstance(module, (Linear, nn.Conv2d, nn.ConvTranspose2d)) and not isinstance(module, Float32Conv2d):
            module.to(dtype)
    return model
