# SPDX-License-Identifier: GPL-3.0-or-later
"""Where patches send the light of diffuse lobes below dielectric layers: these let less of it out at grazing angles.

As in Cycles, which weights a diffuse lobe by what the layer does not reflect towards where the path comes from.
"""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..fresnel import lobe_albedo

COSINES = 16  # for which it is tabulated


class PatchLayers:
    """The layer on each side of patches."""

    def __init__(self, f0: Tensor, roughness: Tensor, diffuse: Tensor):
        """Of sides (S,): f0 and perceptual roughness of the layer, and the share of diffuse light in what they send."""
        cosine = torch.linspace(0, 1, COSINES, device=f0.device)
        reflected = lobe_albedo(*torch.broadcast_tensors(f0[:, None], cosine, roughness[:, None]))
        mean = (reflected * cosine).sum(1, keepdim=True) / cosine.sum()
        excess = diffuse[:, None] * (mean - reflected) / (1 - mean)
        self._factors = F.pad(1 + excess, (0, 0, 0, 1), value=1.0).flatten()

    def factor(self, side: Tensor, cosine: Tensor) -> Tensor:
        """(N,) light that sides (N,) send at a cosine (N,) to their normal, over its mean; 1 behind the last one."""
        at = cosine.clamp(0, 1) * (COSINES - 1)
        low = at.long().clamp_(max=COSINES - 2)
        first = side * COSINES + low
        return torch.lerp(self._factors[first], self._factors[first + 1], at - low)
