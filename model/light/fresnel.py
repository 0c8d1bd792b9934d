# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of a glossy lobe comes from which side: facets that are met at a slant reflect more.

By Schlick's approximation (1994), and the mean of a lobe by both halves of a split sum (Karis 2013). What a reflectance
at normal incidence is given for is 1 at grazing: it is a ratio, and 1 for metals, which reflect alike at all angles.
"""
from __future__ import annotations

from functools import cache

import torch
from torch import Tensor
from torch.nn import functional as F

from ..compute.devices import run_operator
from .sampling import ggx_directions

GRID = 24, 32   # of roughness and cosine
RAYS = 256      # of each
LEAST = 1e-3    # share of the light that a lobe is of at least


def schlick(at_normal: Tensor, cosine: Tensor) -> Tensor:
    """Share of light that facets reflect which meet it at this cosine."""
    return at_normal + (1 - at_normal) * slant(cosine)


def slant(cosine: Tensor) -> Tensor:
    return (1 - cosine).clamp(0, 1) ** 5


def whole(at_normal: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """(P,) share of light from everywhere that the lobe reflects; what bounces between facets is not in it."""
    straight, slanting = _split_sum(cosine, roughness)
    return (at_normal * straight + slanting).clamp_min(LEAST)


def gain(at_normal: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """(P, L) share of the light from lamps that the lobes of P surfaces reflect, over that of light from everywhere.

    at_normal, roughness: (P,); cosine: (P, L).
    """
    of_lamps = _split_sum(*torch.broadcast_tensors(cosine, roughness[:, None]))
    of_all = _split_sum(torch.zeros_like(roughness), roughness, _mean_table(roughness.device))
    lamps, every = (at_normal[:, None] * straight + slanting
                    for straight, slanting in (of_lamps, (x[:, None] for x in of_all)))
    return lamps / every.clamp_min(LEAST)


def _split_sum(cosine: Tensor, roughness: Tensor, table: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Factor of the reflectance at normal incidence, and what slanting facets add; all of one shape."""
    table = _table(cosine.device) if table is None else table
    at = torch.stack([cosine.abs().flatten(), roughness.flatten()], -1) * 2 - 1
    found = run_operator("grid_sampler_2d", F.grid_sample, table, at[None, None], mode="bilinear",
                         padding_mode="border", align_corners=True)
    return found[0, 0].view_as(cosine), found[0, 1].view_as(cosine)


@cache
def _mean_table(device: torch.device) -> Tensor:
    """(1, 2, roughness, 1), of light from everywhere."""
    table = _table(device)
    cosine = torch.linspace(0, 1, GRID[1], device=device)
    return (table * cosine).sum(-1, keepdim=True) / cosine.sum()


@cache
def _table(device: torch.device) -> Tensor:
    """(1, 2, roughness, cosine)."""
    roughness, cosine = (each.flatten() for each in torch.meshgrid(
        *(torch.linspace(0, 1, count) for count in GRID), indexing="ij"))
    cosine = cosine.clamp_min(0.01)
    viewer = torch.stack([(1 - cosine.square()).sqrt(), torch.zeros_like(cosine), cosine], -1)
    up, start = torch.tensor([[0.0, 0.0, 1.0]]).expand_as(viewer), torch.full((len(cosine), 2), 0.5)
    _, weight, towards, _ = ggx_directions(up, viewer, roughness, RAYS, start)
    slanting = slant(towards)
    return torch.stack([(weight * each).mean(1).view(GRID) for each in (1 - slanting, slanting)])[None].to(device)
