# SPDX-License-Identifier: GPL-3.0-or-later
"""How the surface changes within pixels, so that highlights smaller than a pixel are as bright as they should be."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...first_hits.camera_rays import SAMPLE_POINTS
from ...material.reflectance import widened
from ..edge_stopping import edge_weights, plane_tolerance
from ..hit_surfaces import HitSurfaces
from ..vectors import dot, length

LEAST = 0.1  # weight from which on the next pixel shows the same surface
TURNED = 0.02  # squared alpha of a lobe as wide as what a pixel mirrors, over the squared turn of that
EVEN = 0.1   # largest slope of the way to the next pixel, from the surface, where it goes on
OTHER = 9.0  # squared change of the normal, more than there is, to another surface


def footprints(surfaces: HitSurfaces) -> Tensor:
    """(h, W, 2, 9) change of position, normal and direction to the viewer from a pixel to the next one, right and down.

    0 where the pixels around show other surfaces.
    """
    values = torch.cat([surfaces.position, surfaces.normal, -surfaces.rays], -1).permute(2, 0, 1)
    tolerance = plane_tolerance(values[:3], surfaces.is_covered[..., 0])
    return torch.stack([_change(values, tolerance, axis) for axis in (2, 1)], 1).permute(2, 3, 1, 0)


def smooth_steps(surfaces: HitSurfaces) -> Tensor:
    """(h, W, 3, 3) from a pixel to the next one, right and down, where the surface goes on evenly, and how far up a
    point between them has to be to lie above it.

    0 where the surface is folded or ends: points a part of a step off would lie below it, or beside it.
    """
    position, is_smooth, steps = surfaces.position, surfaces.is_covered[..., 0], []
    above = torch.zeros_like(surfaces.roughness)
    for axis in (1, 0):
        step = position.diff(dim=axis)
        ends = [0, 0] * (2 - axis)
        behind, ahead = F.pad(step, (*ends, 1, 0)), F.pad(step, (*ends, 0, 1))
        for change in (-behind, ahead):
            height = dot(change, surfaces.normal)
            above = torch.maximum(above, height)
            is_smooth = is_smooth & (height.abs() <= EVEN * length(change))
        steps.append((behind + ahead) / 2)
    return torch.stack([*steps, above[..., None] * surfaces.normal], 2) * is_smooth[..., None, None]


def mirrored_turn2(footprint: Tensor) -> Tensor:
    """(P,) squared angle by which the mirrored direction turns within pixels, from footprints (P, 2, 9)."""
    weights = torch.tensor([0.0] * 3 + [4.0] * 3 + [1.0] * 3, device=footprint.device).repeat(2)
    return footprint.flatten(1).square() @ weights


def roughness_within(surfaces: HitSurfaces) -> Tensor:
    """(h, W) roughness of lobes as wide as all that pixels mirror, which is much where small surfaces are bent."""
    turn2 = mirrored_turn2(footprints(surfaces).flatten(0, 1)).view_as(surfaces.roughness)
    return widened_by_turn(surfaces.roughness, turn2)


def widened_by_turn(roughness: Tensor, turn2: Tensor) -> Tensor:
    """Roughness of lobes as wide as all that pixels mirror, from `mirrored_turn2` of these; all of one shape."""
    return widened(roughness, TURNED * turn2).clip(max=1)


def points_within(footprint: Tensor) -> Tensor:
    """(K, P, 9) changes of these at K points of pixels, distributed as Cycles' filter, by footprints (P, 2, 9)."""
    return torch.einsum("kj,pji->kpi", offsets_within(footprint.device), footprint)


def offsets_within(device: torch.device) -> Tensor:
    """(K, 2) right and down from the middle of a pixel to points in it and beyond, distributed as Cycles' filter."""
    return torch.from_numpy(np.float32(SAMPLE_POINTS - 0.5)).to(device)


def _change(values: Tensor, tolerance: Tensor, axis: int) -> Tensor:
    """(9, h, W) of values (9, h, W) to the next pixel along an axis: of the steps on both sides that which turns less.

    So a facet stays flat up to its border.
    """
    count = values.shape[axis] - 1
    here, there = (values.narrow(axis, start, count) for start in (0, 1))
    step = there - here
    weight = edge_weights(step[:3], there[3:6], here[3:6], tolerance.narrow(axis - 1, 0, count))
    is_same = weight > LEAST
    step, turn2 = step * is_same, step[3:6].square().sum(0).where(is_same, OTHER)
    ends = [0] * 2 * (2 - axis)
    ahead, behind = (F.pad(step, (*ends, *side)) for side in ((0, 1), (1, 0)))
    turn2_ahead, turn2_behind = (F.pad(turn2, (*ends, *side), value=OTHER) for side in ((0, 1), (1, 0)))
    return torch.where(turn2_ahead <= turn2_behind, ahead, behind)
