# SPDX-License-Identifier: GPL-3.0-or-later
"""Edge-stopping weights: how much light at one point says about light at another, by distance to its plane and normal.

Positions and normals are planes (3, h, w), which PyTorch adds up much faster than the last axis of (h, w, 3).
"""
from __future__ import annotations

from functools import partial

import torch
from torch import Tensor

from .vectors import dot, length

FARTHEST, NEAREST = 0.05, 2e-3  # network units off a plane at which a point counts 1/e, at most and at least
CLOSE = 0.03                    # network units along the plane at which it counts 1/e
TENT = 1 / 16, 1 / 4, 3 / 8, 1 / 4, 1 / 16  # weights of 5x5 points along each axis
SIDE = len(TENT)
DIFFUSE, GLOSSY = 3, 7          # how often the cosine between two normals is squared: mirrors turn light twice as far


def edge_weights(offset: Tensor, neighbour_normal: Tensor, normal: Tensor, tolerance: Tensor,
                 close: float | Tensor | None = None, squarings: int = DIFFUSE) -> Tensor:
    """(..., h, w) weights up to 1 of neighbours at an `offset` from points.

    offset and both normals: (3, ..., h, w). tolerance: (h, w), distance off a point's plane at which a neighbour counts
    1/e; close: the same of any distance, or of each point's (h, w).
    """
    off = (dot(offset, normal, 0) / tolerance).square_()
    if close is not None:
        off += dot(offset, offset, 0) / close ** 2
    facing = dot(neighbour_normal, normal, 0).clamp_min_(0)
    for _ in range(squarings):
        facing.square_()
    return facing * off.neg_().exp_()


def to_planes(picture: Tensor) -> Tensor:
    """(h, w, C) -> (C, h, w)."""
    return picture.permute(2, 0, 1).contiguous()


def plane_tolerance(x: Tensor, valid: Tensor) -> Tensor:
    """(h, w) tolerance of `edge_weights` for points x (3, h, w): the distance of the nearest valid neighbour."""
    apart = torch.full_like(x[0], FARTHEST)
    for axis in (-2, -1):
        low, high = (partial(torch.narrow, dim=axis, start=start, length=x.shape[axis] - 1) for start in (0, 1))
        distance = length(high(x) - low(x), 0).where(high(valid) & low(valid), FARTHEST)
        for end in (low, high):
            end(apart).clamp_(max=distance)
    return apart.clamp_min(NEAREST)


def neighbour_weights(x: Tensor, n: Tensor, tolerance: Tensor, pixel: Tensor, spread: int,
                      close: float | Tensor = CLOSE, squarings: int = DIFFUSE) -> tuple[Tensor, Tensor]:
    """Numbers, row by row, and weights (P, 25) of the 5x5 points `spread` apart around pixels (P,) of h x w.

    x, n: (3, h, w); tolerance, close: as of `edge_weights`. Weights are 0 beyond the sides; they are those of the
    edge-avoiding wavelets that denoise traced light (Dammertz et al. 2010).
    """
    h, w = tolerance.shape
    number = neighbour_numbers(pixel, h, w, spread)
    x, n, tolerance = (picture.flatten(-2) for picture in (x, n, tolerance))
    if isinstance(close, Tensor):
        close = close.flatten()[pixel, None]
    weight = edge_weights(x[:, number] - x[:, pixel, None], n[:, number], n[:, pixel, None], tolerance[pixel, None],
                          close, squarings)
    return number, tent_weights(pixel, h, w, spread) * weight


def neighbour_numbers(pixel: Tensor, h: int, w: int, spread: int) -> Tensor:
    """Numbers (P, 25), row by row, of the 5x5 points `spread` apart around pixels (P,) of h x w.

    Beyond the sides they are of other pixels.
    """
    y, x = _rows_and_columns(pixel, w, spread)
    return (y.clamp(0, h - 1)[:, :, None] * w + x.clamp(0, w - 1)[:, None]).flatten(1)


def tent_weights(pixel: Tensor, h: int, w: int, spread: int) -> Tensor:
    """Weights (P, 25) of the same points by their place alone, 0 beyond the sides."""
    y, x = _rows_and_columns(pixel, w, spread)
    tent = torch.tensor(TENT, device=pixel.device)
    tall, wide = tent * ((y >= 0) & (y < h)), tent * ((x >= 0) & (x < w))
    return (tall[:, :, None] * wide[:, None]).flatten(1)


def _rows_and_columns(pixel: Tensor, w: int, spread: int) -> tuple[Tensor, Tensor]:
    """(P, 5) each, of these points, some beyond the sides."""
    steps = spread * (torch.arange(SIDE, device=pixel.device) - SIDE // 2)
    return (pixel // w)[:, None] + steps, (pixel % w)[:, None] + steps
