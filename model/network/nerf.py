# SPDX-License-Identifier: GPL-3.0-or-later
"""Sinusoidal encoding of small vectors (docs/network.md 3)."""
from __future__ import annotations

import math

import torch


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
