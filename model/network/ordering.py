# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatial order along a 16-bit Hilbert curve (docs/network.md 5.2)."""
from __future__ import annotations

import torch

from ..compute.device_ops import done

BITS = 16  # the order depends on it


def hilbert_grid(positions: torch.Tensor) -> torch.Tensor:
    """(n, 3) float32 -> (n, 3) int64 cells 0..65535 of the anisotropic bounding box; an axis without extent gives 0."""
    if len(positions) == 0:
        return positions.long()
    low, high = positions.amin(dim=0), positions.amax(dim=0)
    extent = high - low
    scaled = (positions - low) / torch.where(extent > 0, extent, torch.ones_like(extent))
    return (scaled * (2 ** BITS - 1)).long()


def hilbert_codes(grid: torch.Tensor) -> torch.Tensor:
    """(n, 3) int64 cells -> (n,) int64 position along the curve, 48 bits (Skilling's transform)."""
    axes = list(grid.unbind(dim=-1))
    for bit in reversed(range(BITS)):
        below = (1 << bit) - 1
        for i in range(3):
            is_set = (axes[i] >> bit & 1).bool()
            exchange = (axes[0] ^ axes[i]) & below
            axes[i] = torch.where(is_set, axes[i], axes[i] ^ exchange)
            # For i = 0 the exchange is empty, so this line alone decides.
            axes[0] = torch.where(is_set, axes[0] ^ below, axes[0] ^ exchange)
    code = torch.zeros_like(axes[0])
    for bit in reversed(range(BITS)):
        for axis in axes:
            code = code << 1 | (axis >> bit & 1)
    for shift in (1, 2, 4, 8, 16, 32):  # Gray code to binary: prefix XOR
        code = code ^ code >> shift
    return code


def hilbert_order(positions: torch.Tensor) -> torch.Tensor:
    """(n, 3) float32 -> (n,) int64 stable order of the points along the curve."""
    return done("sort", torch.argsort, hilbert_codes(hilbert_grid(positions)), stable=True)
