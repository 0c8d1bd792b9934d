# SPDX-License-Identifier: GPL-3.0-or-later
"""How densely photons lie on surfaces: light of lamps that glass has gathered there."""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...scene import RenderScene
from ..direct.direct_light import LightPrior
from ..occluders import bends_light
from .final_gather import Interior
from .photons import photons

SPACINGS = 0.016, 0.032, 0.064  # network units between the nodes of grids
ENOUGH = 120.0  # photons on the area of a node from which on a grid twice as fine is trusted
THIN, THICKER = 4e-3, 0.25  # network units that a layer of nodes is thick, and how much of the spacing more
ALONG = 0.4     # component of a normal from which on its surface is in the grids across that axis
BITS = 20, 16   # of a node's place along either side of its layer, and of the layer


class _Grid(NamedTuple):
    """Nodes (K,) i64 that photons are near, sorted, their light and number (K + 1, 4), and 0 of any other node."""

    spacing: float
    node: Tensor
    light: Tensor


class Caustics:
    """The light of photons on the surfaces where they ended; all in network units, on one device."""

    def __init__(self, position: Tensor, normal: Tensor, flux: Tensor):
        """position, normal (unit, of the side that is lit), flux: (N, 3)."""
        self.grids = [_grid(position, normal, F.pad(flux, (0, 1), value=1.0), spacing) for spacing in SPACINGS]

    def __call__(self, position: Tensor, normal: Tensor) -> Tensor:
        """(P, 3) radiance leaving a white diffuse surface at points (P, 3) with unit normals (P, 3).

        By the finest grid that may know enough photons there.
        """
        *finer, coarsest = self.grids
        if not len(coarsest.node):
            return torch.zeros_like(position)
        found, count = _seen(coarsest, position, normal)
        near = count.nonzero()[:, 0]
        count = count[near]
        for grid in reversed(finer):
            trust = (count / ENOUGH).clamp(max=1)[:, None]  # by the coarser one: beside a focus there are few
            light, count = _seen(grid, position[near], normal[near])
            found[near] = torch.lerp(found[near], light, trust)
        return found


def caustics(scene: RenderScene, prior: LightPrior, interior: Interior, area: Tensor,
             count: int) -> tuple[Caustics, Tensor]:
    """Of a normalised scene, by `count` photons where lamps may light glass.

    And (2 S, 3) radiance that patches of such areas (S,), white and diffuse, send on by them from their sides.
    """
    found, nothing = area.new_zeros(2 * len(area) + 1, 3), area.new_zeros(0, 3)
    glass = np.flatnonzero(bends_light(scene) & ~scene.is_light)
    if not len(glass) or not len(prior.radiance):
        return Caustics(nothing, nothing, nothing), found[:-1]
    landed = photons(scene, prior, glass, interior.corners.cpu().numpy(), interior.surfaces.rays, count)
    position, direction, normal, flux, triangle = (torch.from_numpy(x).to(area.device) for x in landed)
    found.index_add_(0, interior.met(triangle, direction), flux)
    return Caustics(position, normal, flux), found[:-1] / (math.pi * area.clamp_min(1e-20).repeat(2)[:, None])


def _grid(position: Tensor, normal: Tensor, light: Tensor, spacing: float) -> _Grid:
    """Of photons (N, 3) with `light` (N, 4), each in the layers across every axis that its surface is rather across."""
    nodes, parts = [], []
    for axis in range(3):
        of = (normal[:, axis].abs() > ALONG).nonzero()[:, 0]
        node, weight = _nodes(position[of], normal[of], torch.full_like(of, axis), spacing, layers=1)
        nodes.append(node.flatten())
        parts.append((weight[..., None] * light[of, None]).flatten(0, 1))
    node, row = (x.to(light.device) for x in torch.cat(nodes).cpu().unique(return_inverse=True))  # wrong on Macs' GPUs
    return _Grid(spacing, node, light.new_zeros(len(node) + 1, 4).index_add_(0, row, torch.cat(parts)))


def _seen(grid: _Grid, position: Tensor, normal: Tensor) -> tuple[Tensor, Tensor]:
    """Radiance (P, 3) at points with unit normals (P, 3), and number of photons (P,) on the area of a node."""
    axis = normal.abs().argmax(-1)
    node, weight = _nodes(position, normal, axis, grid.spacing, layers=2)
    row = torch.searchsorted(grid.node, node).clamp(max=len(grid.node) - 1)
    row = torch.where(grid.node[row] == node, row, len(grid.node))
    found = (grid.light[row] * weight[..., None]).sum(1)
    cosine = normal.abs().gather(1, axis[:, None])
    return found[:, :3] * cosine / (math.pi * grid.spacing**2), found[:, 3]


def _nodes(position: Tensor, normal: Tensor, axis: Tensor, spacing: float, layers: int) -> tuple[Tensor, Tensor]:
    """Nodes (P, 4 layers) around points (P, 3), as numbers (i64), and their weights, 1 in all of each layer.

    Nodes of layers across an axis (P,) are where the plane of a point, by its unit normal (P, 3), passes them: in that
    layer, and if `layers` are two, in the nearest other one.
    """
    turned = (axis[:, None] + torch.arange(3, device=axis.device)) % 3
    along, slope = normal.gather(1, turned).split([1, 2], 1)
    height, plane = position.gather(1, turned).split([1, 2], 1)
    corner, low = position.new_tensor([[0, 0], [0, 1], [1, 0], [1, 1]]), (plane / spacing).floor()
    share, place = (plane / spacing - low)[:, None], low[:, None] + corner
    weight = torch.where(corner > 0, share, 1 - share).prod(-1)
    away = place * spacing - plane[:, None]
    height = (height - (away * slope[:, None]).sum(-1) / along) / (THIN + THICKER * spacing)
    layer = height.floor()[..., None]
    if layers == 2:
        layer = torch.cat([layer, layer + torch.where(height[..., None] - layer < 0.5, -1.0, 1.0)], -1)
    (x, y), z = _whole(place, BITS[0]).unbind(-1), _whole(layer, BITS[1])
    kind = 2 * axis[:, None] + (along > 0)
    in_layer = kind + 6 * ((x << BITS[0]) + y)
    return (in_layer[..., None] + (6 * z << 2 * BITS[0])).flatten(1), weight.repeat_interleave(layers, 1)


def _whole(place: Tensor, bits: int) -> Tensor:
    """Whole numbers as i64 from 0 on; those beyond so many bits are the last."""
    half = 1 << bits - 1
    return place.clamp(-half, half - 1).long() + half
