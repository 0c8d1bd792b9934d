# SPDX-License-Identifier: GPL-3.0-or-later
"""The transformer's step from light to light: factors of what was estimated and traced, and what both lack."""
from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor
from torch.nn import functional as F

from ..fields import Channels
from ..light.surface_light import SurfaceLight
from .features import FEATURES, GuidedView

# Factors of direct and indirect light by lobe and colour, light that no lobe explains, a factor of the traced light
OUTPUTS = Channels(1, direct=9, indirect=9, rest=3, traced=3)
LARGEST_FACTOR = 4.0  # and its inverse is the smallest
DARK = -8.0           # offset at which softplus adds next to nothing


def corrected_light(raw: Tensor, view: GuidedView) -> SurfaceLight:
    """Decoder channels (V, len(OUTPUTS), H, W) and the light of views -> their light as the network sees it.

    Exposed as the view's light is. Zeros leave the light exactly as it is.
    """
    light, raw = view.light, raw.float()
    direct, indirect = (factor(raw[:, OUTPUTS[name]]).unflatten(1, (3, 3)) for name in ("direct", "indirect"))
    rest = (F.softplus(raw[:, OUTPUTS["rest"]] + DARK) - F.softplus(raw.new_tensor(DARK)))
    diffuse, glossy, transmission = indirect.unbind(1)
    return replace(light, direct=light.direct * direct, bounced=light.bounced * diffuse,
                   reflected=light.reflected * glossy, refracted=light.refracted * transmission,
                   behind=light.behind * transmission, traced=light.traced * factor(raw[:, OUTPUTS["traced"]]),
                   glow=light.glow + rest * view.features[:, FEATURES["alpha"]])


def factor(raw: Tensor) -> Tensor:
    """From 1 / LARGEST_FACTOR to LARGEST_FACTOR; 1 for zero."""
    return torch.exp(math.log(LARGEST_FACTOR) * torch.tanh(raw))
