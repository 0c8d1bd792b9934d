# SPDX-License-Identifier: GPL-3.0-or-later
"""Traced light without its noise, where Blender has no denoiser: by what its estimate knows.

Traced light is right on average, and its estimate is smooth. What the estimate lacks is the mean of their difference
over what lies around on the same surface (edge-avoiding wavelets, Dammertz et al. 2010), the less of it the more it
looks like noise (James and Stein 1961). Traced light that has little noise, such as a sun's, stays as it is: noise
differs from pixel to pixel everywhere, and the error of an estimate along edges alone.
"""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..compute.inference import current_pieces
from ..compute.threads import shared
from ..pictures import bands
from .edge_stopping import SIDE, TENT

SPREADS = 1, 2  # pixels between the points of the wavelets
ALIKE = 0.2     # difference of normals, albedos and roughness at which a pixel around counts half as much, or so
NOISE = 4.0     # variances of the mean difference, whose square is halved if it is as large
CLEAN = 5.0     # variances of a pixel's noise, of which half is left if what would be left out is as large
UNSEEN = 4e-3   # of the light, a difference that is not seen
NEAR, FAR = 1, 2  # pixels around, in which light that is left out, and noise, are looked for
REACH = SIDE // 2 * sum(SPREADS) + FAR + 1  # pixels
ROOT_OF_NORMAL = 0.822            # mean of the root of the size of a standard normal number
BAND_PIXELS = 1 << 16             # at a time, of each thread


def without_noise(traced: Tensor, estimate: Tensor, surface: Tensor) -> Tensor:
    """(V, 3, H, W) of noisy traced light and its estimate (V, 3, H, W), where surfaces look like (V, C, H, W)."""
    height, width = traced.shape[2:]

    def of_band(outer: slice, inner: slice) -> Tensor:
        noisy, smooth = traced[..., outer, :], estimate[..., outer, :]
        difference = noisy - smooth
        smooth = smooth + _lacking(difference, surface[..., outer, :])
        return smooth.lerp(noisy, _cleanness(noisy, difference, noisy - smooth))[..., inner, :].clamp_min(0)

    rows = bands(height, width, REACH, current_pieces().limit(BAND_PIXELS))
    return torch.cat(shared(of_band, *zip(*rows, strict=True), device=traced.device), -2)


def _lacking(difference: Tensor, surface: Tensor) -> Tensor:
    """(V, 3, H, W) the mean difference around pixels, without noise."""
    mean, spread = difference, torch.ones_like(difference[:, :1])  # of the variance of the mean
    square = difference.mean(1, keepdim=True).square()
    for step in SPREADS:
        mean, square, spread = _smoothed(torch.cat([mean, square], 1), spread, surface, step)
    signal = mean.mean(1, keepdim=True).square()
    noise = (square - signal).clamp_min(0) * spread
    return mean * signal / (signal + NOISE * noise).clamp_min(1e-20)


def _cleanness(traced: Tensor, difference: Tensor, left_out: Tensor) -> Tensor:
    """(V, 1, H, W) how far `traced` light (V, 3, H, W) is to be believed, which differs so from its estimate, and from
    what is left of it without noise."""
    traced, difference, left_out = (x.mean(1, keepdim=True) for x in (traced, difference, left_out))
    right, below = (F.pad(difference.diff(dim=dim), pad, mode="replicate")
                    for dim, pad in ((3, (0, 1, 0, 0)), (2, (0, 0, 0, 1))))
    noise2 = torch.minimum(_usual2(right), _usual2(below)) / 2  # along an edge nothing changes
    most = mean_around(traced, FAR)  # a firefly is no signal
    left2 = mean_around(left_out.abs().minimum(most).square(), NEAR)
    signal2 = (left2 - noise2).clamp_min(0) + (UNSEEN * most).square()
    return signal2 / (signal2 + CLEAN * noise2).clamp_min(1e-20)


def _usual2(values: Tensor) -> Tensor:
    """(V, 1, H, W) squared size of most of the values around, whatever a few are: as of a normal number."""
    return (mean_around(values.abs().sqrt(), FAR) / ROOT_OF_NORMAL) ** 4


def mean_around(values: Tensor, reach: int) -> Tensor:
    """(V, 1, H, W) means of pixels up to so far."""
    return F.avg_pool2d(F.pad(values, (reach,) * 4, mode="replicate"), 2 * reach + 1, 1)


def _smoothed(values: Tensor, spread: Tensor, surface: Tensor, step: int) -> tuple[Tensor, Tensor, Tensor]:
    """Means of `values` (V, 4, H, W), the first three and the last, over 5x5 pixels `step` apart, and their spread."""
    (height, width), reach = values.shape[2:], SIDE // 2 * step
    around = F.pad(torch.cat([values, spread, surface, torch.ones_like(spread)], 1), (reach,) * 4)
    total, weights, squares = (torch.zeros_like(x) for x in (values, spread, spread))
    for down, tall in enumerate(TENT):
        for right, wide in enumerate(TENT):
            there = around[..., step * down:step * down + height, step * right:step * right + width]
            value, spread_there, surface_there, is_in = there.split([4, 1, surface.shape[1], 1], 1)
            unlike = (surface_there - surface).square_().sum(1, keepdim=True)
            weight = tall * wide * is_in * (unlike / (-2 * ALIKE ** 2)).exp_()
            total.addcmul_(weight, value)
            weights += weight
            squares.addcmul_(weight.square(), spread_there)
    mean, square = (total / weights).split([3, 1], 1)
    return mean, square, squares / weights.square()
