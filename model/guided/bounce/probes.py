# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute light at some pixels (probes) and interpolate it to all others."""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

GRID = 4          # pixels between two probes, which stand in the middle of their cells
FINE = 2, 256     # the same in pictures smaller than so many pixels
NEAR = 0.05       # network units off a pixel's plane at which a probe counts 1/e
CLOSE = 0.06       # network units at which one of the probes that a probe becomes the mean of counts 1/e
FACING = 8        # exponent of the cosine between the normals of pixel and probe
LEAST = 1e-5      # weight that keeps the sum above zero
TENT = 3 / 8, 1 / 4, 1 / 16  # weights of the 5x5, by how far they are
SPREADS = (1, 2)  # probes between those of which a probe takes the mean, 5x5 at a time


def grid_of(picture_size: int) -> int:
    """Pixels between two probes of a picture with this longer side."""
    grid, below = FINE
    return grid if picture_size < below else GRID


def gathered(light: Callable[[Tensor, Tensor, Tensor], Tensor], position: Tensor, normal: Tensor, covered: Tensor,
             grid: int = GRID, noisy: bool = False) -> Tensor:
    """(h, w, C) of a `light` that knows (P, C) at points and normals (P, 3) of probes (P,) by number.

    position and normal: (h, w, 3).

    0 where a pixel is not covered, of which (h, w, 1) tells.

    Each pixel takes the mean of the four nearest probes, weighted by how far they are off its plane and turned away.
    Those of a `noisy` light are made means of the probes around before, weighted alike (Dammertz et al. 2010, the
    edge-avoiding wavelets that denoise traced light).
    """
    h, w = position.shape[:2]
    place = [(torch.arange(grid // 2, side, grid, device=position.device) if side > grid // 2
              else torch.zeros(1, dtype=torch.long, device=position.device)) for side in (h, w)]
    rows, columns = torch.meshgrid(*place, indexing="ij")
    x, n, valid = (a[rows, columns] for a in (position, normal, covered))
    number = torch.arange(rows.numel(), device=position.device).view_as(rows)
    where = valid.flatten().nonzero()[:, 0]  # a GPU is waited for here, once
    known = light(x.flatten(0, 1)[where], n.flatten(0, 1)[where], number.flatten()[where])
    if not len(known):
        return known.new_zeros(h, w, known.shape[-1])
    found = known.new_zeros(rows.numel(), known.shape[-1]).index_copy(0, where, known).unflatten(0, x.shape[:2])
    for spread in SPREADS if noisy else ():
        found = _mean_around(found, x, n, valid, spread)
    total = weights = 0.0
    for down in (0, 1):
        for right in (0, 1):
            i, y = _neighbour(h, len(place[0]), grid, down, position.device)
            j, z = _neighbour(w, len(place[1]), grid, right, position.device)
            i, j = i[:, None].expand(h, w), j[None].expand(h, w)
            alike = _alike(x[i, j] - position, n[i, j], normal)
            weight = (y[:, None] * z[None])[..., None] * (alike + LEAST) * valid[i, j]
            total, weights = total + weight * found[i, j], weights + weight
    return total / torch.clamp(weights, min=LEAST ** 2) * covered


def _alike(away: Tensor, there: Tensor, normal: Tensor) -> Tensor:
    """(..., 1) up to 1: how much a probe with normal `there`, `away` from a point with a normal, says about it."""
    off = (away * normal).sum(-1, keepdim=True) / NEAR
    return (-off.square()).exp() * (there * normal).sum(-1, keepdim=True).clamp_min(0) ** FACING


def _mean_around(found: Tensor, x: Tensor, n: Tensor, valid: Tensor, spread: int) -> Tensor:
    """(h, w, C) of probes, each the mean of 5x5 that stand `spread` apart."""
    h, w = valid.shape[:2]
    total, weights = torch.zeros_like(found), torch.zeros_like(valid, dtype=found.dtype)
    for down in range(-2, 3):
        for right in range(-2, 3):
            dy, dx = down * spread, right * spread
            here = slice(max(-dy, 0), min(h - dy, h)), slice(max(-dx, 0), min(w - dx, w))
            there = slice(max(dy, 0), min(h + dy, h)), slice(max(dx, 0), min(w + dx, w))
            away = x[there] - x[here]
            near = (-(away / CLOSE).square().sum(-1, keepdim=True)).exp()
            weight = TENT[abs(down)] * TENT[abs(right)] * near * _alike(away, n[there], n[here]) * valid[there]
            total[here] += weight * found[there]
            weights[here] += weight
    return torch.where(weights > 0, total / weights.clamp_min(1e-12), found)


def _neighbour(side: int, count: int, grid: int, further: int, device) -> tuple[Tensor, Tensor]:
    """Index of the probe before or behind each pixel along an axis, and its linear weight."""
    at = ((torch.arange(side, device=device) - grid // 2) / grid).clamp(0, count - 1)
    low = at.floor().long().clamp(max=max(count - 2, 0))
    share = at - low
    return (low + further).clamp(max=count - 1), share if further else 1 - share
