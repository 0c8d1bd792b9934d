# SPDX-License-Identifier: GPL-3.0-or-later
"""Where on each patch the light that falls on it is found."""
from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from ..direct.terminator import edge_heights, heights
from ..sampling import hashed_starts, triangle_weights
from .openness import Openness
from .patches import Patches

PLACES = 8         # on a patch that are tried
STEPS = 0.8191725134, 0.6710436067, 0.5497004779  # of the R3 sequence (Roberts 2018), from each to the next
LEAST_ALONG = 0.2  # of a shading normal along the normal


class PatchPoints(NamedTuple):
    """A point on the front of each patch, (S, 3) each.

    As in Cycles, light falls by the shading normals, but only on what it meets from the front of the curved surface
    that these describe.
    """

    position: Tensor
    normal: Tensor   # unit
    shading: Tensor  # unit normals for shading
    up: Tensor       # the way up from `position` to the curved surface

    def on_both_sides(self) -> tuple[tuple[Tensor, Tensor], ...]:
        """The same four of fronts and of backs, above which no surface is curved."""
        x, normal, shading, up = self
        return (x, x), (normal, -normal), (shading, -shading), (up, torch.zeros_like(up))


def patch_points(patches: Patches, openness: Openness | None = None) -> PatchPoints:
    """Points spread over patches by chance; with `openness` the first of PLACES that is not inside of something.

    Of a floor in which things stand only what is around them is seen, and that is not in their shadow all over.
    """
    order = patches.patch.argsort(stable=True)
    cumulative = patches.facing.norm(dim=-1)[order].double().cumsum(0)  # area up to each triangle's end, by patch
    ends = cumulative[patches.patch[order].bincount(minlength=len(patches.center)).cumsum(0) - 1]
    begins = F.pad(ends[:-1], (1, 0))

    def points(row: Tensor, start: Tensor) -> PatchPoints:
        share, u, v = start.T
        chosen = torch.searchsorted(cumulative, begins[row] + share * (ends - begins)[row])
        return _on_triangles(patches, order[chosen.clamp(max=len(order) - 1)], triangle_weights(u, v))

    row, start = torch.arange(len(patches.center)), hashed_starts(patches.center, 3)
    found = points(row, start)
    for place in range(1, PLACES if openness else 1):
        row = row[openness.is_buried(found.position[row], found.normal[row])]
        if not len(row):
            break
        for of_all, others in zip(found, points(row, (start[row] + place * torch.tensor(STEPS)) % 1), strict=True):
            of_all[row] = others
    return found


def _on_triangles(patches: Patches, triangle: Tensor, weights: Tensor) -> PatchPoints:
    """Points at weights (P, 3) of triangles (P,)."""
    corners, normals, turned = patches.corners[triangle], patches.normals[triangle], patches.turned[triangle]
    height = heights(edge_heights(corners, normals), weights)
    height = (height + (weights * patches.height[triangle]).sum(1)).clamp_min(0)
    normal = F.normalize(patches.facing[triangle], dim=-1)
    shading = turned * F.normalize((weights[..., None] * normals).sum(1), dim=-1)
    along = (shading * normal).sum(-1, keepdim=True)
    shading = F.normalize(shading + (LEAST_ALONG - along).clamp_min(0) * normal, dim=-1)
    up = height[:, None] * (turned > 0) * shading
    return PatchPoints((weights[..., None] * corners).sum(1), normal, shading, up)
