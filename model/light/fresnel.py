# SPDX-License-Identifier: GPL-3.0-or-later
"""Fresnel reflectance of glossy lobes: facets that light meets at a slant reflect more.

By Schlick's approximation (1994); the mean over a lobe is both halves of a split sum (Karis 2013). f0, the reflectance
at normal incidence, is relative to that at grazing angles. Of metals it is the base color, as of the Principled BSDF.
"""
from __future__ import annotations

from functools import cache

import torch
from torch import Tensor
from torch.nn import functional as F

from ..compute.devices import run_operator
from .sampling import ggx_directions

GRID = 24, 32       # roughnesses and cosines in the table
RAYS = 256          # of each entry
LEAST_ALBEDO = 1e-3
MEAN_SLANT = 1 / 21         # of `slant` over uniform light
SMOOTH = 4.08567, 1.00071   # of the mean reflectance of a smooth dielectric (Kulla and Conty 2017)


def schlick(f0: Tensor, cosine: Tensor) -> Tensor:
    """Reflectance of facets that light meets at this cosine."""
    return f0 + (1 - f0) * slant(cosine)


def slant(cosine: Tensor) -> Tensor:
    """The weight of grazing reflectance in `schlick`."""
    return (1 - cosine).clamp(0, 1) ** 5


def lobe_albedo(f0: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """(P,) share of uniform light that the lobe reflects to a viewer at this cosine, without light between facets."""
    straight, slanting = _split_sum(cosine, roughness)
    return (f0 * straight + slanting).clamp_min(LEAST_ALBEDO)


def layer_albedo(f0: Tensor, roughness: Tensor, facets: Tensor | None = None) -> Tensor:
    """(P,) share of uniform light that dielectric layers reflect.

    f0, roughness (perceptual): (P,); facets: (P,), another roughness that they are blurred to. Light between facets is
    made up for by the roughness of the layer itself, as in Cycles (Kulla and Conty 2017).
    """
    amplitude = f0.sqrt()
    index = (1 + amplitude) / (1 - amplitude).clamp_min(1e-3)
    smooth = (index - 1) / (SMOOTH[0] + SMOOTH[1] * index)
    straight, slanting = _uniform_sum(roughness if facets is None else facets)
    grazing = (smooth - f0).clamp_min(0) / MEAN_SLANT / (1 - f0).clamp_min(1e-3)  # 1 in Schlick's approximation
    between = smooth * (1 / sum(_uniform_sum(roughness)) - 1).clamp_min(0)
    return (f0 * straight + grazing * slanting) * (1 + between)


def gain(f0: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """(P, E) share of the light of E emitters that the lobes of P surfaces reflect, relative to that of uniform light.

    f0, roughness: (P,); cosine: (P, E), at which the light arrives.
    """
    of_emitters = _split_sum(*torch.broadcast_tensors(cosine, roughness[:, None]))
    of_uniform = _uniform_sum(roughness)
    emitters, uniform = (f0[:, None] * straight + slanting
                         for straight, slanting in (of_emitters, (x[:, None] for x in of_uniform)))
    return emitters / uniform.clamp_min(LEAST_ALBEDO)


def _split_sum(cosine: Tensor, roughness: Tensor, table: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Factor of f0, and what slanting facets add to it; all of one shape."""
    table = _table(cosine.device) if table is None else table
    at = torch.stack([cosine.abs().flatten(), roughness.flatten()], -1) * 2 - 1
    sampled = run_operator("grid_sampler_2d", F.grid_sample, table, at[None, None], mode="bilinear",
                         padding_mode="border", align_corners=True)
    return sampled[0, 0].view_as(cosine), sampled[0, 1].view_as(cosine)


def _uniform_sum(roughness: Tensor) -> tuple[Tensor, Tensor]:
    """The same of uniform light."""
    return _split_sum(torch.zeros_like(roughness), roughness, _mean_table(roughness.device))


@cache
def _mean_table(device: torch.device) -> Tensor:
    """(1, 2, roughness, 1), for uniform light."""
    table = _table(device)
    cosine = torch.linspace(0, 1, GRID[1], device=device)
    return (table * cosine).sum(-1, keepdim=True) / cosine.sum()


@cache
def _table(device: torch.device) -> Tensor:
    """(1, 2, roughness, cosine)."""
    roughness, cosine = (axis.flatten() for axis in torch.meshgrid(
        *(torch.linspace(0, 1, count) for count in GRID), indexing="ij"))
    cosine = cosine.clamp_min(0.01)
    viewer = torch.stack([(1 - cosine.square()).sqrt(), torch.zeros_like(cosine), cosine], -1)
    up, start = torch.tensor([[0.0, 0.0, 1.0]]).expand_as(viewer), torch.full((len(cosine), 2), 0.5)
    _, weight, towards, _ = ggx_directions(up, viewer, roughness, RAYS, start)
    slanting = slant(towards)
    return torch.stack([(weight * share).mean(1).view(GRID) for share in (1 - slanting, slanting)])[None].to(device)
