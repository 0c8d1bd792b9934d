# SPDX-License-Identifier: GPL-3.0-or-later
"""Lambert's vector of outlines that the horizon may cut: exact for light that a diffuse surface sends on.

Its z is 2 pi times the form factor of what is above the horizon. Rings of K unit vectors around the outlines at R
points are planes (K, 3, R), in which z is up.
"""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from ..vectors import cross, dot, length, unit

STEPS = 4  # edges that follow the horizon where it cuts an outline


def lambert_vector(ring: Tensor, mapped: Callable[[Tensor, Tensor], Tensor] = lambda rows, towards: towards) -> Tensor:
    """(3, R) of what is above z = 0 within rings (K, 3, R).

    mapped: what unit vectors (K, 3, N) at points `rows` (N,) become before edges join them.
    """
    vector, is_up = torch.zeros_like(ring[0]), ring[:, 2] > 0
    is_whole = is_up.all(0)
    for where, within in ((is_whole, _within), (is_up.any(0) & ~is_whole, _within_cut)):
        rows = where.nonzero()[:, 0]
        if len(rows):
            vector[:, rows] = within(ring[..., rows], lambda towards, rows=rows: mapped(rows, towards))
    return vector


def _within(ring: Tensor, mapped: Callable[[Tensor], Tensor]) -> Tensor:
    corners = mapped(ring)
    return _arcs(corners, corners.roll(-1, 0)).sum(0)


def _within_cut(ring: Tensor, mapped: Callable[[Tensor], Tensor]) -> Tensor:
    """Edges end at the horizon, and others follow it from the first to the last."""
    following = ring.roll(-1, 0)
    z, next_z = ring[:, 2:], following[:, 2:]
    is_up, next_is_up = z > 0, next_z > 0
    crossing = unit(ring + (following - ring) * z / torch.where(is_up == next_is_up, 1.0, z - next_z), 1)
    edges = _arcs(mapped(torch.where(is_up, ring, crossing)), mapped(torch.where(next_is_up, following, crossing)))
    sinks, rises = is_up & ~next_is_up, ~is_up & next_is_up
    first, last = ((crossing * where).sum(0) for where in (sinks, rises))
    steps = torch.linspace(0, 1, STEPS + 1, device=ring.device)[:, None, None]
    horizon = mapped(unit(torch.lerp(first, last, steps), 1))
    return (edges * (is_up | next_is_up)).sum(0) + _arcs(horizon[:-1], horizon[1:]).sum(0)


def _arcs(a: Tensor, b: Tensor) -> Tensor:
    """(K, 3, R) of Lambert's formula for edges from unit vectors a to b (K, 3, R)."""
    across = cross(a, b, 1)
    sine = length(across, 1)
    return (torch.atan2(sine, dot(a, b, 1)) / sine.clamp_min(1e-12))[:, None] * across
