# SPDX-License-Identifier: GPL-3.0-or-later
"""Fresnel reflectance of glossy lobes: facets that light meets at a slant reflect more.

As in Cycles, dielectrics by their real curve and metals by Schlick's (1994); the mean over a lobe is both halves of a
split sum (Karis 2013). f0, the reflectance at normal incidence, is relative to that at grazing angles and tells the two
apart. Of metals it is the base color, as of the Principled BSDF.
"""
from __future__ import annotations

from functools import cache

import torch
from torch import Tensor
from torch.nn import functional as F

from ..compute.devices import run_operator
from ..material.reflectance import LAYERS, metal_share, split_sum_table

DIELECTRIC, METAL = 0.05, 0.1  # f0 up to which surfaces are dielectrics, and from which on metal
LEAST_ALBEDO = 1e-3
MEAN_SLANT = 1 / 21         # of `slant` of metals over uniform light
SMOOTH = 4.08567, 1.00071   # of the mean reflectance of a smooth dielectric (Kulla and Conty 2017)


def reflectance(f0: Tensor, cosine: Tensor) -> Tensor:
    """Reflectance of facets that light meets at this cosine."""
    return f0 + (1 - f0) * slant(f0, cosine)


def slant(f0: Tensor, cosine: Tensor) -> Tensor:
    """How far they reflect as at grazing angles, where they reflect all light."""
    cosine, layer = cosine.clamp(0, 1), f0.clamp(LAYERS[0], LAYERS[-1])
    amplitude = layer.sqrt()
    g = (((1 + amplitude) / (1 - amplitude)).square() - 1 + cosine.square()).sqrt()
    along = (cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)
    of_layer = ((g - cosine) / (g + cosine)).square() / 2 * (1 + along.square())
    return torch.lerp((of_layer - layer) / (1 - layer), (1 - cosine) ** 5, is_metal(f0))


def is_metal(f0: Tensor) -> Tensor:
    """Share of metal, whose curve is Schlick's."""
    return ((f0 - DIELECTRIC) / (METAL - DIELECTRIC)).clamp(0, 1)


def lobe_albedo(f0: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """(P,) share of uniform light that the lobe reflects to a viewer at this cosine, without light between facets."""
    straight, slanting = _split_sum(f0, cosine, roughness)
    return (f0 * straight + slanting).clamp_min(LEAST_ALBEDO)


def layer_albedo(f0: Tensor, roughness: Tensor, facets: Tensor | None = None) -> Tensor:
    """(P,) share of uniform light that dielectric layers reflect.

    f0, roughness (perceptual): (P,); facets: (P,), another roughness that they are blurred to. Light between facets is
    made up for by the roughness of the layer itself, as in Cycles (Kulla and Conty 2017).
    """
    smooth = _smooth_albedo(f0)
    straight, slanting = _uniform_sum(f0, roughness if facets is None else facets)
    exact, tabled = ((_smooth_albedo(x) - x).clamp_min(0) / (1 - x).clamp_min(1e-3)
                     for x in (f0, f0.clamp_min(LAYERS[0])))
    grazing = exact / torch.lerp(tabled, torch.full_like(f0, MEAN_SLANT), is_metal(f0))
    between = smooth * (1 / sum(_uniform_sum(f0, roughness)) - 1).clamp_min(0)
    return (f0 * straight + grazing * slanting) * (1 + between)


def single_scattering(base: Tensor, roughness: Tensor) -> Tensor:
    """(P, 3) share of what metals of a base color (P, 3) reflect of uniform light whose facets do not light each other;
    roughness: (P,)."""
    white = sum(_uniform_sum(torch.ones_like(roughness), roughness))[:, None]
    return white / metal_share(base, white, 0.0)


def _smooth_albedo(f0: Tensor) -> Tensor:
    """(P,) share of uniform light that smooth dielectrics reflect."""
    amplitude = f0.sqrt()
    index = (1 + amplitude) / (1 - amplitude).clamp_min(1e-3)
    return (index - 1) / (SMOOTH[0] + SMOOTH[1] * index)


def gain(f0: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """(P, E) share of the light of E emitters that the lobes of P surfaces reflect, relative to that of uniform light.

    f0, roughness: (P,); cosine: (P, E), at which the light arrives.
    """
    of_emitters = _split_sum(*torch.broadcast_tensors(f0[:, None], cosine, roughness[:, None]))
    of_uniform = _uniform_sum(f0, roughness)
    emitters, uniform = (f0[:, None] * straight + slanting
                         for straight, slanting in (of_emitters, (x[:, None] for x in of_uniform)))
    return emitters / uniform.clamp_min(LEAST_ALBEDO)


def _split_sum(f0: Tensor, cosine: Tensor, roughness: Tensor, table: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Factor of f0, and what slanting facets add to it; all of one shape."""
    table = _table(cosine.device) if table is None else table
    at = torch.stack([cosine.abs().flatten(), roughness.flatten()], -1) * 2 - 1
    sampled = run_operator("grid_sampler_2d", F.grid_sample, table, at[None, None], mode="bilinear",
                           padding_mode="border", align_corners=True)[0, :, 0]
    white, of_metal, *of_layers = (x.view_as(cosine) for x in sampled)
    of_layer = of_layers[0]
    for low, high, following in zip(LAYERS, LAYERS[1:], of_layers[1:], strict=False):
        of_layer = torch.lerp(of_layer, following, ((f0 - low) / (high - low)).clamp(0, 1))
    slanting = torch.lerp(of_layer, of_metal, is_metal(f0))
    return white - slanting, slanting


def _uniform_sum(f0: Tensor, roughness: Tensor) -> tuple[Tensor, Tensor]:
    """The same of uniform light."""
    return _split_sum(f0, torch.zeros_like(roughness), roughness, _mean_table(roughness.device))


@cache
def _mean_table(device: torch.device) -> Tensor:
    """(1, C, roughness, 1), for uniform light."""
    table = _table(device)
    cosine = torch.linspace(0, 1, table.shape[-1], device=device)
    return (table * cosine).sum(-1, keepdim=True) / cosine.sum()


@cache
def _table(device: torch.device) -> Tensor:
    """(1, C, roughness, cosine), of whites, metals and layers as of `split_sum`."""
    return torch.from_numpy(split_sum_table()).float()[None].to(device)
