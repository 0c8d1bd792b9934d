# SPDX-License-Identifier: GPL-3.0-or-later
"""What rough glass shows of the light behind it."""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..edge_stopping import neighbour_weights, plane_tolerance, to_planes
from ..hit_surfaces import HitSurfaces
from ..weighted_rows import weighted_rows
from .facets import LEAST_ROUGHNESS

SPREADS = 1, 2, 4, 8, 16  # pixels between the 5x5 of each of the means that follow each other
WIDTH = 0.3               # network units along the surface at which a pixel counts 1/e, at roughness 1
BRIGHT = 30.0             # times what rough glass shows, at which a pixel counts half: single paths find light of lamps


def frosted(light: Tensor, surfaces: HitSurfaces) -> Tensor:
    """Means of radiance (h, W, C), which one path of each pixel found, over the wider a neighbourhood the rougher glass
    is.

    It grows with the square of the roughness, as the lobe does. Only pixels of the same surface count (the
    edge-avoiding wavelets of `neighbour_weights`).
    """
    is_glass = surfaces.is_glass[..., 0]
    is_rough = is_glass & (surfaces.roughness > LEAST_ROUGHNESS)
    if not is_rough.any():
        return light
    x, n = map(to_planes, (surfaces.position, surfaces.normal))
    tolerance, close = plane_tolerance(x, is_glass), WIDTH * surfaces.roughness.clamp_min(LEAST_ROUGHNESS).square()
    brightness = light.mean(-1)
    common = BRIGHT * brightness[is_rough].sqrt().mean().square().clamp_min(1e-12)
    counts = is_glass * common / (common + brightness)
    for spread in SPREADS:
        number, weight = neighbour_weights(x, n, tolerance, spread, close)
        table = F.pad(light.flatten(0, 1), (0, 1), value=1.0)
        total = weighted_rows(table, number, weight * counts.flatten()[number])
        mean = total[:, :-1] / total[:, -1:].clamp_min(1e-6)
        light, counts = torch.where(is_rough[..., None], mean.view_as(light), light), is_glass
    return light
