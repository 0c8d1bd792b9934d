# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute light at some pixels (probes) and interpolate it to all others."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

GRID = 4          # pixels between two probes, which stand in the middle of their cells
FINE = 2, 256  # the same in pictures smaller than so many pixels
NEAR, NEAREST = 0.05, 2e-3  # network units off a pixel's plane, at most and at least, at which a probe counts 1/e
CLOSE = 0.03        # network units at which one of the probes that a probe becomes the mean of counts 1/e
FACING = 8        # exponent of the cosine between the normals of pixel and probe
TRUSTED = 0.5     # what probes around must say about a pixel for it to need none of its own
LEAST = 1e-5      # weight that keeps the sum above zero
TENT = 3 / 8, 1 / 4, 1 / 16  # weights of the 5x5, by how far they are
NOISY, NOISELESS = (1, 2), ()  # probes between those of which a probe takes the mean, 5x5 at a time


def grid_of(picture_size: int) -> int:
    """Pixels between two probes of a picture with this longer side."""
    grid, below = FINE
    return grid if picture_size < below else GRID


def gathered(light: Callable[..., Tensor], position: Tensor, normal: Tensor, covered: Tensor, *known: Tensor,
             grid: int = GRID, spreads: tuple[int, ...] = NOISELESS,
             tolerance: float | None = None, finest: int = GRID) -> Tensor:
    """(h, w, C) of a `light` that knows (P, C) at points and normals (P, 3) of probes (P,) by number.

    position and normal: (h, w, 3); `known`: (h, w, ...), what else is to be told of the probes.

    0 where a pixel is not covered, of which (h, w, 1) tells.

    Each pixel takes the mean of the four nearest probes, weighted by how far they are off its plane and turned away.
    With `spreads` probes are made means of those around before, weighted alike (Dammertz et al. 2010, the edge-avoiding
    wavelets that denoise traced light). With a `tolerance` what differs by as much counts 1/e, from the second on.
    Where the probes around say little, there are more of them, down to every `finest` pixel.
    """
    def lit(probes: _Probes, where: Tensor) -> Tensor:
        """(N, C) at those of the probes, whose rows and columns are (N,) each."""
        return light(*(a[where] for a in (probes.x, probes.n, probes.number, *(probes.of(a) for a in known))))

    probes = _Probes(position, normal, covered, grid)
    where = probes.valid[..., 0].nonzero().unbind(1)  # a GPU is waited for here, once
    at_probes = lit(probes, where)
    if not len(at_probes):
        return at_probes.new_zeros(*position.shape[:2], at_probes.shape[-1])
    found = at_probes.new_zeros(*probes.valid.shape[:2], at_probes.shape[-1]).index_put(where, at_probes)
    for i, spread in enumerate(spreads):
        found = _mean_around(found, probes, spread, tolerance if i else None)
    while probes.grid > finest:
        more = _Probes(position, normal, covered, probes.grid // 2)
        found, trust = probes.interpolated(found, more.rows, more.columns, more.x, more.n)
        where = (more.valid & (trust < TRUSTED))[..., 0].nonzero().unbind(1)
        found, probes = found.index_put(where, lit(more, where)), more
    h, w = position.shape[:2]
    pixels = (torch.arange(side, device=position.device) for side in (h, w))
    return probes.interpolated(found, *pixels, position, normal)[0] * covered


class _Probes:
    """Pixels that stand `grid` apart: position and normal `x`, `n` (h, w, 3), `valid` (h, w, 1) where covered."""

    def __init__(self, position: Tensor, normal: Tensor, covered: Tensor, grid: int):
        device = position.device
        self.grid = grid
        self.rows, self.columns = ((torch.arange(grid // 2, side, grid, device=device) if side > grid // 2
                                    else torch.zeros(1, dtype=torch.long, device=device))
                                   for side in position.shape[:2])
        self.x, self.n, self.valid = (self.of(a) for a in (position, normal, covered))
        self.number = _z_order(*(torch.arange(len(p), device=device) for p in (self.rows, self.columns)))
        self.near = _near(self.x, self.valid)

    def of(self, picture: Tensor) -> Tensor:
        return picture[self.rows[:, None], self.columns]

    def interpolated(self, found: Tensor, rows: Tensor, columns: Tensor, position: Tensor,
                     normal: Tensor) -> tuple[Tensor, Tensor]:
        """(h, w, C) of what was `found` at the probes, at pixels with such `rows` (h,), `columns` (w,) and (h, w, 3).

        And (h, w, 1), how much the probes say about them, 1 at most.
        """
        total = weights = 0.0
        for down in (0, 1):
            for right in (0, 1):
                i, y = _neighbour(rows, len(self.rows), self.grid, down)
                j, z = _neighbour(columns, len(self.columns), self.grid, right)
                i, j = i[:, None].expand(len(rows), len(columns)), j[None].expand(len(rows), len(columns))
                alike = _alike(self.x[i, j] - position, self.n[i, j], normal, self.near[i, j])
                weight = (y[:, None] * z[None])[..., None] * (alike + LEAST) * self.valid[i, j]
                total, weights = total + weight * found[i, j], weights + weight
        return total / torch.clamp(weights, min=LEAST ** 2), weights


def _z_order(rows: Tensor, columns: Tensor) -> Tensor:
    """(h, w) numbers that follow each other within every square of 2, 4, 8... probes, from 0 again every 64."""
    bits = range(6)
    down, right = (sum(((i >> bit) & 1) << (2 * bit) for bit in bits) for i in (rows, columns))
    return 2 * down[:, None] + right[None]


def _near(x: Tensor, valid: Tensor) -> Tensor:
    """(h, w, 1) how far off a point's plane a probe says much about it: as far as the nearest of its neighbours is."""
    apart = torch.full_like(x[..., :1], NEAR)
    for low, high in (np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:]):
        way = (x[high] - x[low]).norm(dim=-1, keepdim=True).where(valid[high] & valid[low], x.new_tensor(NEAR))
        apart[low], apart[high] = torch.minimum(apart[low], way), torch.minimum(apart[high], way)
    return apart.clamp_min(NEAREST)


def _alike(away: Tensor, there: Tensor, normal: Tensor, near: Tensor) -> Tensor:
    """(..., 1) up to 1: how much a probe with normal `there`, `away` from a point with a normal, says about it.

    near: (..., 1), how far off the point's plane it counts 1/e.
    """
    off = (away * normal).sum(-1, keepdim=True) / near
    return (-off.square()).exp() * (there * normal).sum(-1, keepdim=True).clamp_min(0) ** FACING


def _mean_around(found: Tensor, probes: _Probes, spread: int, tolerance: float | None) -> Tensor:
    """(h, w, C) of probes, each the mean of 5x5 that stand `spread` apart."""
    x, n, valid, near = probes.x, probes.n, probes.valid, probes.near
    h, w = valid.shape[:2]
    total, weights = torch.zeros_like(found), torch.zeros_like(valid, dtype=found.dtype)
    for down in range(-2, 3):
        for right in range(-2, 3):
            dy, dx = down * spread, right * spread
            here = slice(max(-dy, 0), min(h - dy, h)), slice(max(-dx, 0), min(w - dx, w))
            there = slice(max(dy, 0), min(h + dy, h)), slice(max(dx, 0), min(w + dx, w))
            away = x[there] - x[here]
            close = (-(away / CLOSE).square().sum(-1, keepdim=True)).exp()
            alike = _alike(away, n[there], n[here], near[here])
            weight = TENT[abs(down)] * TENT[abs(right)] * close * alike * valid[there]
            if tolerance is not None:
                apart = (found[there] - found[here]).abs().amax(-1, keepdim=True)
                weight = weight * (-(apart / tolerance).square()).exp()
            total[here] += weight * found[there]
            weights[here] += weight
    return torch.where(weights > 0, total / weights.clamp_min(1e-12), found)


def _neighbour(pixels: Tensor, count: int, grid: int, further: int) -> tuple[Tensor, Tensor]:
    """Index of the probe before or behind each pixel along an axis, and its linear weight."""
    at = ((pixels - grid // 2) / grid).clamp(0, count - 1)
    low = at.floor().long().clamp(max=max(count - 2, 0))
    share = at - low
    return (low + further).clamp(max=count - 1), share if further else 1 - share
