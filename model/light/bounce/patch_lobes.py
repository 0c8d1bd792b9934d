# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the glossy layers of patches send the light of emitters: around the direction that a mirror would send it.

A patch sends all other light to all sides alike (radiosity). But a wall that a sun lights at a slant lights the floor
before it, and a floor that it lights from above hardly the walls.
"""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..fresnel import lobe_albedo, reflectance
from ..sampling import smith_root
from ..vectors import dot

LEAST_COSINE = 0.05  # of light to a patch


class PatchLobes:
    """One GGX lobe for each side of patches, of the light from the mean direction of emitters."""

    def __init__(self, normal: Tensor, toward: Tensor, f0: Tensor, roughness: Tensor):
        """Of sides (S,): unit normals (S, 3); `toward` (S, 3), the mean direction of the light, the shorter the more
        the directions differ; f0 and perceptual roughness (S,) of the lobe.
        """
        self.concentration = concentration = toward.norm(dim=-1).clamp(max=1)  # (S,)
        direction = F.normalize(toward, dim=-1).T
        cosine = dot(direction, normal.T, 0).clamp_min(LEAST_COSINE)
        alpha2 = roughness.square().square()
        scale = concentration / (2 * lobe_albedo(f0, cosine, roughness))
        self._parts = F.pad(torch.stack([*normal.T, *direction, cosine, smith_root(cosine, alpha2), alpha2, f0, scale,
                                         concentration]), (0, 1))

    def excess(self, side: Tensor, ray: Tensor) -> Tensor:
        """(N,) radiance that lobes of sides (N,) send against unit rays (3, N), over that of matte sides, less 1.

        The sides behind the last send none.
        """
        parts = self._parts.index_select(1, side)
        normal, direction = parts[:3], parts[3:6]
        before, root_before, alpha2, f0, scale, concentration = parts[6:]
        after = dot(normal, ray, 0).neg_().clamp_min_(0)
        half = direction - ray
        length2 = dot(half, half, 0).clamp_min_(1e-6)
        facet2 = dot(normal, half, 0).square_() / length2     # squared cosine of facets
        facing = length2.sqrt_() / 2                       # cosine of light on them
        shape = alpha2 / (facet2 * (alpha2 - 1) + 1).square_()
        masking = (after * root_before + before * smith_root(after, alpha2)).clamp_min_(1e-6)
        return scale * reflectance(f0, facing) * shape / masking - concentration
