# SPDX-License-Identifier: GPL-3.0-or-later
"""What surfaces that are not quite smooth show of the light that one path of each pixel found.

Such a surface mirrors an image that is the more blurred, the farther off what it shows is. The paths of neighbours end
around the mirrored direction, so those that a pixel's lobe reaches count for it too (as rays are shared in Stachowiak
2015, "Stochastic screen-space reflections").
"""
from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from ..chunks import in_chunks
from ..edge_stopping import neighbour_numbers, plane_tolerance, tent_weights, to_planes
from ..hit_surfaces import HitSurfaces
from ..vectors import cross, dot, length, unit
from ..weighted_rows import weighted_rows
from .ends import REFLECTED

SPREADS = 1, 2, 4, 8, 16  # pixels between the 5x5 of each of the means that follow each other
SMOOTH = 0.03             # roughness up to which an image stays as it is
WIDTH = 2.0               # alpha of a lobe -> tangent at which a path counts 1/e in each of the means
OUTSIDE = 4.0             # squares of that tangent, from which on a path counts next to nothing
INSIDE = 0.01             # the same, up to which the paths around are one
LEAST_COSINE = 0.1        # of a mirrored direction to the normal, beyond which a lobe becomes no wider
FAR = 4.0                 # network units to the sky
CHUNK = 1 << 13           # pixels at a time


def blurred_image(light: Tensor, end: Tensor, is_end: Tensor, surfaces: HitSurfaces) -> Tensor:
    """Means of radiance (h, W, C) from the ends (h, W, 3) of paths, where there are any (h, W, 1), over the lobes of
    `surfaces`."""
    h, w, channels = light.shape
    is_followed = REFLECTED.is_followed(surfaces.glossy, surfaces.roughness)
    is_rough = (is_followed & (surfaces.roughness > SMOOTH)).flatten()
    if not is_rough.any():
        return light
    lobes = _Lobes.of(surfaces, end, is_end, is_followed)
    off = lobes.nearest_off(h, w)
    light = F.pad(light.reshape(-1, channels), (0, 1), value=1.0)
    for spread in SPREADS:
        rows = (is_rough & (spread ** 2 * off < OUTSIDE) & (spread ** 2 * off > INSIDE)).nonzero()[:, 0]
        if len(rows):
            mean = in_chunks(CHUNK, lambda row, spread=spread, light=light: weighted_rows(
                light, *lobes.weights(row, h, w, spread)), rows)
            light = light.index_put((rows,), mean / mean[:, -1:].clamp_min(1e-6))
    return light[:, :channels].reshape(h, w, channels)


@dataclass
class _Lobes:
    """Lobes of h W pixels, and what their paths reach.

    axes: in the plane of incidence and across, over the lobe's tangents; along the path; the normal over the tolerance
    of the surface's plane.
    """

    place: Tensor  # (10, h W): position, normal; where the path ends as if it were straight; the size of a pixel there
    axes: Tensor   # (12, h W)
    width2: Tensor  # (h W,), squared tangents

    @classmethod
    def of(cls, surfaces: HitSurfaces, end: Tensor, is_end: Tensor, is_followed: Tensor) -> _Lobes:
        x, n, rays, end = map(to_planes, (surfaces.position, surfaces.normal, surfaces.rays, end))
        cosine = -dot(n, rays, 0)
        along = rays + 2 * cosine * n
        distance = torch.where(is_end[..., 0], (end - x).square().sum(0).sqrt(), FAR)
        size = (length(surfaces.position - surfaces.origin) + distance).square() * is_followed
        across = unit(cross(n, along, 0), 0)
        width = WIDTH * surfaces.roughness.clamp_min(SMOOTH).square()
        in_plane = cross(along, across, 0) / width
        across = across / (width * cosine.clamp_min(LEAST_COSINE))
        upward = n / plane_tolerance(x, surfaces.is_covered[..., 0])
        return cls(torch.cat([x, n, x + distance * along, size[None]]).flatten(1),
                   torch.cat([in_plane, across, along, upward]).flatten(1), width.flatten().square())

    def nearest_off(self, h: int, w: int) -> Tensor:
        """(h W,) least `_off_axis` of the ends of paths of the next pixels."""
        steps = torch.tensor([-w, -1, 1, w], device=self.place.device)
        number = (torch.arange(h * w, device=steps.device)[:, None] + steps).clamp(0, h * w - 1)
        x, end = self.place[:3, :, None], self.place[6:9, number]
        return _off_axis(end - x, *self.axes[:9, :, None].split(3))[0].amin(1)

    def weights(self, row: Tensor, h: int, w: int, spread: int) -> tuple[Tensor, Tensor]:
        """Numbers and weights (R, 25) of the pixels around those of numbers (R,)."""
        number = neighbour_numbers(row, h, w, spread)
        x, n = self.place[:6, row, None].split(3)
        there, normal, end, size = self.place[:, number].split([3, 3, 3, 1])
        in_plane, across, along, upward = self.axes[:, row, None].split(3)
        off, depth2 = _off_axis(end - x, in_plane, across, along)
        off = off + dot(there - x, upward, 0).square()
        off = off + dot(normal - n, normal - n, 0) / self.width2[row, None]  # paths of other facets end elsewhere
        return number, tent_weights(row, h, w, spread) * (-off).exp() * size[0] / depth2


def _off_axis(toward: Tensor, in_plane: Tensor, across: Tensor, along: Tensor) -> tuple[Tensor, Tensor]:
    """How far the ends of paths `toward` (3, R, K) points are off the axes of lobes (3, R, 1), squared and over the
    tangents of these, and their squared depth."""
    depth2 = dot(toward, along, 0).clamp_min(1e-6).square()
    return (dot(toward, in_plane, 0).square() + dot(toward, across, 0).square()) / depth2, depth2
