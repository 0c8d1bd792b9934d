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
    off = (dot(away, normal) / near).square_()
    if close is not None:
        off += dot(away, away) / close ** 2
    facing = dot(there, normal).clamp_min_(0)
    return facing.square_().square_().square_() * off.neg_().exp_()


def dot(a: Tensor, b: Tensor) -> Tensor:
    """(3, ...) each -> (...), without the products of a sum over the first axis, which take three times as long."""
    return torch.addcmul(torch.addcmul(a[0] * b[0], a[1], b[1]), a[2], b[2])


def nearness(x: Tensor, valid: Tensor) -> Tensor:
    """(h, w) how far off a point's plane a neighbour says much about it: as far as the nearest of these is."""
    apart = torch.full_like(x[0], NEAR)
    for axis in (-2, -1):
        low, high = (partial(torch.narrow, dim=axis, start=start, length=x.shape[axis] - 1) for start in (0, 1))
        way = (high(x) - low(x)).square().sum(0).sqrt().where(high(valid) & low(valid), NEAR)
        for end in (low, high):
            end(apart).clamp_(max=way)
    return apart.clamp_min(NEAREST)


def alike_around(x: Tensor, n: Tensor, near: Tensor, spread: int) -> tuple[Tensor, Tensor]:
    """What 5x5 places `spread` apart say about each of h x w: their numbers, row by row, and weights (h w, 25).

    Weights are 0 beyond the sides; they are those of the edge-avoiding wavelets that denoise traced light (Dammertz et
    al. 2010).
    """
    h, w = near.shape
    reach = SIDE // 2 * spread
    places, steps, weights = F.pad(torch.cat([x, n]), (reach,) * 4), [], []
    for down, tall in enumerate(TENT):
        for right, wide in enumerate(TENT):
            top, left = spread * down, spread * right
            there, normal = places[:, top:top + h, left:left + w].split(3)
            weights.append(tall * wide * alike(there - x, normal, n, near, CLOSE))
            steps.append((top - reach) * w + left - reach)
    number = torch.arange(h * w, device=x.device)[:, None] + torch.tensor(steps, device=x.device)
    return number.clamp(0, h * w - 1), torch.stack(weights).flatten(1).T.contiguous()
