# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light within pixels that see several surfaces, each of which mirrors lamps in its own way."""
from __future__ import annotations

import torch
from torch import Tensor

from ..hit_surfaces import HitSurfaces
from ..vectors import unit
from .direct_light import DirectLight
from .footprints import footprints

DARK = 1e-4      # radiance beside which less is no light
MOST_GAIN = 8.0  # of a sample over the pixels whose light it shows


class UnshadowedLight:
    """Direct light at the pixels of a picture, past all that is in its way."""

    def __init__(self, direct: DirectLight, surfaces: HitSurfaces, with_footprints: bool):
        self._direct, self._origin = direct, surfaces.origin
        self._points = surfaces.lobe_points
        self._footprints = [footprints(surfaces).flatten(0, 1)] if with_footprints else []

    def gain(self, position: Tensor, normal: Tensor, neighbours: Tensor, weight: Tensor) -> Tensor:
        """(6, E, K) how much more light samples get than the `neighbours` (E, 9) that they are the mean of.

        position, normal: (3, E, K) of the samples; weight: (E, K, 9) of the neighbours, with sum 1. The result is of
        [3 lobe + rgb] of the diffuse and the glossy lobe.
        """
        pixel, place = neighbours.unique(return_inverse=True)
        around = self._lobes(*(x[pixel] for x in self._points), *(x[pixel] for x in self._footprints))
        around = torch.einsum("ekn,cen->cek", weight, around[:, place])
        x, n = (values.flatten(1).T for values in (position, normal))
        roughness, f0 = (torch.einsum("ekn,en->ek", weight, values[neighbours]).flatten()
                         for values in self._points[3:])
        at_samples = self._lobes(x, n, unit(self._origin - x), roughness, f0).view_as(around)
        return ((at_samples + DARK) / (around + DARK)).clamp(max=MOST_GAIN)

    def _lobes(self, *points: Tensor) -> Tensor:
        """(6, P)."""
        diffuse, glossy, _ = self._direct.lobes(*points[:5], None, *points[5:])
        return torch.cat([diffuse, glossy], 1).T
