# SPDX-License-Identifier: GPL-3.0-or-later
"""Exposure by what a view shows, and the encoding in which networks and losses compare pictures."""
from __future__ import annotations

import torch
from torch import Tensor

KEY = 0.18                # log average of what a view sees, in its exposure
LEAST_OF_MEAN = 0.01      # added to every pixel before its logarithm, times the mean


def key_exposure(luminance: Tensor) -> Tensor:
    """Factor that puts the log average of (..., P) at KEY (Reinhard et al. 2002); 1 where all is dark. (...)"""
    if not luminance.shape[-1]:
        return luminance.new_ones(luminance.shape[:-1])
    mean = luminance.mean(-1, keepdim=True)
    average = (luminance + LEAST_OF_MEAN * mean).log().mean(-1).exp()
    return torch.where(average > 0, KEY / average.clamp_min(1e-20), 1.0)


def display_encode(radiance: Tensor) -> Tensor:
    """sRGB-encoded; beyond 1 it grows slowly, so that gradients of what is too bright do not vanish."""
    x = radiance.clamp_min(0)
    curve = 1.055 * x.clamp(0.0031308, 1) ** (1 / 2.4) - 0.055
    return torch.where(x > 0.0031308, curve, 12.92 * x) + 0.1 * x.clamp_min(1).log()
