# SPDX-License-Identifier: GPL-3.0-or-later
"""What rough glass shows of the light behind it."""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..chunks import in_chunks
from ..edge_stopping import SIDE, neighbour_weights, plane_tolerance, to_planes
from ..hit_surfaces import HitSurfaces
from ..vectors import dot, length
from ..weighted_rows import weighted_rows
from .facets import LEAST_ROUGHNESS
from .glossy_image import FAR

SPREADS = 1, 2, 4, 8, 16  # pixels between the 5x5 of each of the means that follow each other
WIDTH = 0.3               # network units along the surface at which a pixel counts 1/e, at roughness 1
LOBE = 0.7                # the same, over the distance at which its paths end
PIXELS = 2.0              # at which a pixel counts 1/e at least: the mean of fewer paths is noise
CHUNK = 1 << 13           # pixels at a time
BRIGHT = 30.0             # times what rough glass shows, at which a pixel counts half: single paths find light of lamps


def frosted(light: Tensor, surfaces: HitSurfaces, end: Tensor, is_end: Tensor) -> Tensor:
    """Means of radiance (h, W, C), which one path of each pixel found, over the wider a neighbourhood the rougher glass
    is, and the farther behind it paths end.

    end: (h, W, 3) of paths, in network units; is_end: (h, W) bool, of those that end at surfaces. It grows with the
    square of the roughness, as the lobe does. Only pixels of the same surface count (the edge-avoiding wavelets of
    `neighbour_weights`).
    """
    is_rough = _is_rough(surfaces)
    if not is_rough.any():
        return light
    reach = SPREADS[-1] * (SIDE // 2)
    sides = (is_rough.any(axis).nonzero() for axis in (1, 0))
    box = tuple(slice(max(int(side[0]) - reach, 0), int(side[-1]) + reach + 1) for side in sides)
    light = light.clone()
    light[box] = _frosted(light[box], surfaces.crop(box), end[box], is_end[box])
    return light


def _is_rough(surfaces: HitSurfaces) -> Tensor:
    """(h, W) bool: pixels of rough glass."""
    return surfaces.is_glass[..., 0] & (surfaces.roughness > LEAST_ROUGHNESS)


def _frosted(light: Tensor, surfaces: HitSurfaces, end: Tensor, is_end: Tensor) -> Tensor:
    """The same, of surfaces some of which are rough glass."""
    is_glass, is_rough = surfaces.is_glass[..., 0], _is_rough(surfaces)
    x, n = map(to_planes, (surfaces.position, surfaces.normal))
    lobe = surfaces.roughness.clamp_min(LEAST_ROUGHNESS).square()
    tolerance, close = plane_tolerance(x, is_glass), WIDTH * lobe
    brightness = light.mean(-1)
    common = BRIGHT * brightness[is_rough].sqrt().mean().square().clamp_min(1e-12)
    counts = is_glass * common / (common + brightness)
    nearness = 1 / torch.where(is_end, length(end - surfaces.position), FAR).clamp_min(1e-4)
    is_found = (is_glass & (is_end | light.any(-1))).flatten()  # other paths were lost in glass
    row, point, width2 = is_rough.flatten().nonzero()[:, 0], surfaces.position.flatten(0, 1), None
    rays = surfaces.rays.flatten(0, 1)

    def across2(row: Tensor, number: Tensor) -> Tensor:
        """(P, K) squared distances of pixels of numbers (P, K) from those of `row` (P,), across the rays of these."""
        apart = point[number] - point[row, None]
        return (dot(apart, apart) - dot(apart, rays[row, None]).square()).clamp_min_(0)

    for spread in SPREADS:
        number, weight = neighbour_weights(x, n, tolerance, row, spread, close)
        if width2 is None:
            near = _means(nearness[..., None], number, weight * is_found[number])[:, 0]
            width = torch.maximum(LOBE * lobe.flatten()[row] / near.clamp_min(1e-6), PIXELS * tolerance.flatten()[row])
            width2 = torch.full_like(lobe.flatten(), torch.inf).index_put((row,), width.square())
        off = in_chunks(CHUNK, across2, row, number) / torch.minimum(width2[number], width2[row, None])
        weight = weight * off.neg_().exp_()
        mean = _means(light, number, weight * counts.flatten()[number])
        light, counts = light.flatten(0, 1).index_put((row,), mean).view_as(light), is_glass
    return light


def _means(values: Tensor, number: Tensor, weight: Tensor) -> Tensor:
    """(P, C) of values (h, W, C) at the pixels of numbers (P, K), by their weights."""
    total = weighted_rows(F.pad(values.flatten(0, 1), (0, 1), value=1.0), number, weight)
    return total[:, :-1] / total[:, -1:].clamp_min(1e-6)
