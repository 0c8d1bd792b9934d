# SPDX-License-Identifier: GPL-3.0-or-later
"""How much light at one place says about light at another: by how far it is off its plane, and turned away.

Positions and normals are planes (3, h, w), which PyTorch adds up much faster than the last axis of (h, w, 3).
"""
from __future__ import annotations

from functools import partial

import torch
from torch import Tensor
from torch.nn import functional as F

NEAR, NEAREST = 0.05, 2e-3  # network units off a plane, at most and at least, at which a place counts 1/e
CLOSE = 0.03                # network units at which one counts 1/e that lies on the plane
TENT = 1 / 16, 1 / 4, 3 / 8, 1 / 4, 1 / 16  # weights of 5x5 places along each axis
SIDE = len(TENT)


def alike(away: Tensor, there: Tensor, normal: Tensor, near: Tensor, close: float | None = None) -> Tensor:
    """(..., h, w) up to 1: how much places with normals `there`, `away` from those with a `normal`, say about these.

    All are (3, ..., h, w). near: (h, w), how far off their planes a place counts 1/e; close: how far at all.
    """
    off = ((away * normal).sum(0) / near).square()
    if close is not None:
        off += (away / close).square().sum(0)
    facing = (there * normal).sum(0).clamp_min(0)
    return (-off).exp() * facing.square().square().square()


def nearness(x: Tensor, valid: Tensor) -> Tensor:
    """(h, w) how far off a point's plane a neighbour says much about it: as far as the nearest of these is."""
    apart = torch.full_like(x[0], NEAR)
    for axis in (-2, -1):
        low, high = (partial(torch.narrow, dim=axis, start=start, length=x.shape[axis] - 1) for start in (0, 1))
        way = (high(x) - low(x)).square().sum(0).sqrt().where(high(valid) & low(valid), NEAR)
        for end in (low, high):
            end(apart).clamp_(max=way)
    return apart.clamp_min(NEAREST)


def around(x: Tensor, spread: int) -> Tensor:
    """(C, h, w) -> (C, 25, h, w): the 5x5 places that stand `spread` apart; 0 beyond the sides."""
    return F.unfold(x[None], SIDE, dilation=spread, padding=SIDE // 2 * spread).view(len(x), SIDE ** 2, *x.shape[1:])


def alike_around(x: Tensor, n: Tensor, near: Tensor, spread: int) -> Tensor:
    """(25, h, w) weights of what those places say; the edge-avoiding wavelets that denoise traced light (Dammertz et
    al. 2010)."""
    tent = x.new_tensor(TENT)
    return (tent * tent[:, None]).view(-1, 1, 1) * alike(around(x, spread) - x[:, None], around(n, spread), n[:, None],
                                                         near, CLOSE)
