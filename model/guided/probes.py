# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth light at every pixel from what is gathered at every GRID-th one."""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

GRID = 4          # pixels between two probes, which stand in the middle of their cells
NEAR = 0.05       # network units off a pixel's plane at which a probe counts 1/e
FACING = 8        # exponent of the cosine between the normals of pixel and probe
LEAST = 1e-5      # weight that keeps the sum above zero


def gathered(light: Callable[[Tensor, Tensor], Tensor], position: Tensor, normal: Tensor, covered: Tensor) -> Tensor:
    """(h, w, C) of a `light` that knows (P, C) at points and normals (P, 3); position and normal (h, w, 3).

    0 where a pixel is not covered, of which (h, w, 1) tells.

    Each pixel takes the mean of the four nearest probes, weighted by how far they are off its plane and turned away.
    """
    h, w = position.shape[:2]
    place = [(torch.arange(GRID // 2, side, GRID, device=position.device) if side > GRID // 2
              else torch.zeros(1, dtype=torch.long, device=position.device)) for side in (h, w)]
    rows, columns = torch.meshgrid(*place, indexing="ij")
    x, n, valid = (a[rows, columns] for a in (position, normal, covered))
    known = light(x[valid[..., 0]], n[valid[..., 0]])
    if not len(known):
        return known.new_zeros(h, w, known.shape[-1])
    found = known.new_zeros(*x.shape[:2], known.shape[-1])
    found[valid[..., 0]] = known
    total = weights = 0.0
    for down in (0, 1):
        for right in (0, 1):
            i, y = _neighbour(h, len(place[0]), down, position.device)
            j, z = _neighbour(w, len(place[1]), right, position.device)
            i, j = i[:, None].expand(h, w), j[None].expand(h, w)
            off = ((x[i, j] - position) * normal).sum(-1, keepdim=True) / NEAR
            facing = (n[i, j] * normal).sum(-1, keepdim=True).clamp_min(0) ** FACING
            weight = (y[:, None] * z[None])[..., None] * ((-off.square()).exp() * facing + LEAST) * valid[i, j]
            total, weights = total + weight * found[i, j], weights + weight
    return total / torch.clamp(weights, min=LEAST ** 2) * covered


def _neighbour(side: int, count: int, further: int, device) -> tuple[Tensor, Tensor]:
    """Index of the probe before or behind each pixel along an axis, and its linear weight."""
    at = ((torch.arange(side, device=device) - GRID // 2) / GRID).clamp(0, count - 1)
    low = at.floor().long().clamp(max=max(count - 2, 0))
    share = at - low
    return (low + further).clamp(max=count - 1), share if further else 1 - share
