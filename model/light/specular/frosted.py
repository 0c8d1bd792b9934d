# SPDX-License-Identifier: GPL-3.0-or-later
"""What rough glass shows of the light behind it."""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..edge_stopping import neighbour_weights, plane_tolerance
from ..hit_surfaces import HitSurfaces
from ..weighted_rows import weighted_rows

SPREADS = 1, 2, 4, 8             # pixels between the 5x5 of one mean
ROUGHNESS = 0.15, 0.3, 0.45, 0.6  # from which on there is such a mean
RAMP = 0.15                      # of roughness, from none of it to all of it


def frosted(light: Tensor, surfaces: HitSurfaces) -> Tensor:
    """Means of radiance (h, W, C), as smooth glass would show it, over the wider a neighbourhood the rougher glass is.

    Only pixels of the same surface count (the edge-avoiding wavelets of `neighbour_weights`).
    """
    glass = surfaces.transmission.amax(-1) > 0
    shares = [((surfaces.roughness - least) / RAMP).clamp(0, 1) * glass for least in ROUGHNESS]
    if not shares[0].any():
        return light
    x, n = (picture.permute(2, 0, 1).contiguous() for picture in (surfaces.position, surfaces.normal))
    tolerance, glass = plane_tolerance(x, glass), glass.flatten()
    for spread, share in zip(SPREADS, shares):
        if not share.any():
            break
        number, weight = neighbour_weights(x, n, tolerance, spread)
        total = weighted_rows(F.pad(light.flatten(0, 1), (0, 1), value=1.0), number, weight * glass[number])
        mean = total[:, :-1] / total[:, -1:].clamp_min(1e-6)
        light = torch.lerp(light, mean.view_as(light), share[..., None])
    return light
