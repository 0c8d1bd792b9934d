# SPDX-License-Identifier: GPL-3.0-or-later
"""Where patches with dielectric layers send their light: of the diffuse lobe below less gets out at grazing angles, and
the layer sends more there of what comes from everywhere.

As in Cycles, which weights a diffuse lobe by what the layer does not reflect towards where the path comes from.
"""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ...material.reflectance import blurred
from ..fresnel import lobe_albedo

COSINES = 16  # for which it is tabulated


class PatchLayers:
    """The layer on each side of patches."""

    def __init__(self, f0: Tensor, roughness: Tensor, diffuse: Tensor, even: Tensor):
        """Of sides (S,): f0 and perceptual roughness of the layer; and of what they send the share of the diffuse lobe,
        and of what the layer reflects of light from everywhere."""
        cosine = torch.linspace(0, 1, COSINES, device=f0.device)
        excess = torch.zeros_like(f0)[:, None]
        for share, facets, sign in ((diffuse, roughness, -1), (even, blurred(roughness), 1)):
            albedo = lobe_albedo(*torch.broadcast_tensors(f0[:, None], cosine, facets[:, None]))
            mean = (albedo * cosine).sum(1, keepdim=True) / cosine.sum()
            excess = excess + share[:, None] * sign * (albedo - mean) / (mean if sign > 0 else 1 - mean)
        self._factors = F.pad(1 + excess, (0, 0, 0, 1), value=1.0).flatten()

    def factor(self, side: Tensor, cosine: Tensor) -> Tensor:
        """(N,) light that sides (N,) send at a cosine (N,) to their normal, over its mean; 1 behind the last one."""
        at = cosine.clamp(0, 1) * (COSINES - 1)
        low = at.long().clamp_(max=COSINES - 2)
        first = side * COSINES + low
        return torch.lerp(self._factors[first], self._factors[first + 1], at - low)
