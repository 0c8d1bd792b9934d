# SPDX-License-Identifier: GPL-3.0-or-later
"""What surfaces that are not quite smooth show of the light that one path of each pixel found.

Such a surface mirrors an image that is the more blurred, the farther off what it shows is. The paths of neighbours end
around the mirrored direction, so those that a pixel's lobe reaches count for it too (as rays are shared in Stachowiak
2015, "Stochastic screen-space reflections").
"""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..edge_stopping import dot, edge_weights, neighbours, plane_tolerance
from ..hit_surfaces import HitSurfaces
from ..weighted_rows import weighted_rows

SPREADS = 1, 2, 4, 8, 16  # pixels between the 5x5 of each of the means that follow each other
SMOOTH = 0.03             # roughness up to which an image stays as it is
WIDTH = 2.0               # alpha of a lobe -> tangent at which a path counts 1/e in each of the means
GRAZING = 0.1             # least cosine
FAR = 4.0                 # network units to the sky


def blurred_image(light: Tensor, end: Tensor, is_end: Tensor, surfaces: HitSurfaces) -> Tensor:
    """Means of radiance (h, W, C) from the ends (h, W, 3) of paths, where there are any (h, W, 1), over the lobes of
    `surfaces`."""
    is_rough = surfaces.is_covered[..., 0] & (surfaces.roughness > SMOOTH)
    if not is_rough.any():
        return light
    x, n, rays, end = (picture.permute(2, 0, 1).contiguous() for picture in (
        surfaces.position, surfaces.normal, surfaces.rays, end))
    cosine = -dot(n, rays)
    along = rays + 2 * cosine * n
    distance = torch.where(is_end[..., 0], (end - x).square().sum(0).sqrt(), FAR)
    reached = x + distance * along
    area = ((surfaces.position - surfaces.origin).norm(dim=-1) + distance).square()[None]  # relative, of a pixel there
    across = F.normalize(torch.linalg.cross(n, along, dim=0), dim=0)
    width = WIDTH * surfaces.roughness.clamp_min(SMOOTH).square()
    in_plane = torch.linalg.cross(along, across, dim=0) / width
    across = across / (width * cosine.clamp_min(GRAZING))
    tolerance = plane_tolerance(x, surfaces.is_covered[..., 0])
    for spread in SPREADS:
        weights, numbers = [], []
        for number, tent, (there, normal, other, size) in neighbours((x, n, reached, area), spread):
            toward = other - x
            depth2 = dot(toward, along).clamp_min(1e-6).square()
            off = dot(toward, in_plane).square() + dot(toward, across).square()
            lobe = (-off / depth2).exp() * size[0] / depth2
            weights.append(tent * lobe * edge_weights(there - x, normal, n, tolerance))
            numbers.append(number)
        number, weight = torch.stack(numbers, -1).flatten(0, 1), torch.stack(weights, -1).flatten(0, 1)
        mean = weighted_rows(F.pad(light.flatten(0, 1), (0, 1), value=1.0), number, weight)
        mean = mean[:, :-1] / mean[:, -1:].clamp_min(1e-6)
        light = torch.where(is_rough[..., None], mean.view_as(light), light)
    return light
