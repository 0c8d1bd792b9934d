# SPDX-License-Identifier: GPL-3.0-or-later
"""Density of photons on surfaces: light of emitters that glass has focused there."""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...compute.threads import shared
from .surface_elements import near_many_photons, near_photons, surface_elements

SPACINGS = 0.016, 0.032, 0.064  # network units between the nodes of the grids
ENOUGH = 120.0  # photons on the area of a node from which on a grid twice as fine is used
FEW = 8.0     # up to which it is not: there the area of surfaces is not measured as finely, which may be far off
NOISE = 0.7   # standard deviations by which light must differ for that, up to one more
THIN, THICKER = 4e-3, 0.25  # thickness of a layer of nodes: network units, and the share of the spacing added
ALONG = 0.4     # component of a normal from which on its surface is in the grids across that axis
ELEMENT = 0.75  # of the spacing, length of the elements by which the area of surfaces is measured
BITS = 20, 16   # of the coordinates of a node in its layer, and of the layer


class _Grid(NamedTuple):
    """Sorted nodes (K,) i64 near photons; the last row of the light is 0, for other nodes."""

    spacing: float
    node: Tensor
    light: Tensor  # (K + 1, 5) flux and number of photons, area of the surfaces


class PhotonMap:
    """Photons on the surfaces where they ended; all in network units, on one device (Jensen 1996)."""

    def __init__(self, position: Tensor, normal: Tensor, flux: Tensor, surfaces: np.ndarray | None = None,
                 most_grids: int = len(SPACINGS)):
        """position, normal (unit, of the side that is lit), flux: (N, 3).

        surfaces: (G, 3, 3) triangles that photons can end on; without any, all are large and flat. most_grids: how many
        of the coarsest grids there are, at most.
        """
        place, reach = position.cpu().numpy(), 2 * SPACINGS[-1]
        near = np.zeros((0, 3, 3), np.float32) if surfaces is None else near_photons(surfaces, place, reach)
        light = F.pad(F.pad(flux, (0, 1), value=1.0), (0, 1))

        def grid(spacing: float) -> _Grid:
            is_coarsest = spacing == SPACINGS[-1]
            parts = near if is_coarsest else near_many_photons(near, place, 2 * spacing, reach)
            middle, up, area = (torch.from_numpy(x).to(flux) for x in surface_elements(parts, ELEMENT * spacing))
            area = F.pad(area[:, None], (4, 0))
            return _grid(torch.cat([position, middle, middle]), torch.cat([normal, up, -up]),
                         torch.cat([light, area, area]), spacing)

        self.grids = shared(grid, SPACINGS[-most_grids:], device=flux.device)

    @classmethod
    def empty(cls, like: Tensor) -> PhotonMap:
        """Without photons, on the device of a tensor."""
        return cls(*[like.new_zeros(0, 3)] * 3)

    def radiance(self, position: Tensor, normal: Tensor) -> Tensor:
        """(P, 3) radiance leaving a white diffuse surface at points (P, 3) with unit normals (P, 3).

        By the finest grid that holds enough photons there.
        """
        *finer, coarsest = self.grids
        if not len(coarsest.node):
            return torch.zeros_like(position)
        radiance, count = _look_up(coarsest, position, normal)
        near = count.nonzero()[:, 0]
        count = count[near]
        for grid in reversed(finer):
            # By the coarser grid: beside a focus there are few photons.
            fine = ((count - FEW) / ENOUGH).clamp(0, 1)[:, None]
            coarse, expected = radiance[near], count / 4
            finer_radiance, count = _look_up(grid, position[near], normal[near])
            fine = fine * _differs(coarse, finer_radiance, torch.maximum(count, expected))
            radiance[near] = torch.lerp(coarse, finer_radiance, fine)
        return radiance


def _differs(coarse: Tensor, fine: Tensor, count: Tensor) -> Tensor:
    """(P, 1) whether radiance (P, 3) of a finer grid differs by more than the noise of so many photons (P,)."""
    coarse, fine = coarse.mean(1), fine.mean(1)
    noise = torch.maximum(coarse, fine) / count.clamp_min(1e-9).sqrt()
    return ((fine - coarse).abs() / noise.clamp_min(1e-20) - NOISE).clamp(0, 1)[:, None]


def _grid(position: Tensor, normal: Tensor, light: Tensor, spacing: float) -> _Grid:
    """A grid of photons and elements (N, 3) with `light` (N, 5), in layers across their surface's main axes."""
    nodes, parts = [], []
    for axis in range(3):
        photon = (normal[:, axis].abs() > ALONG).nonzero()[:, 0]
        node, weight = _nodes(position[photon], normal[photon], torch.full_like(photon, axis), spacing, layers=1)
        nodes.append(node.flatten())
        parts.append((weight[..., None] * light[photon, None]).flatten(0, 1))
    node, row = (x.to(light.device) for x in torch.cat(nodes).cpu().unique(return_inverse=True))  # wrong on Macs' GPUs
    return _Grid(spacing, node, light.new_zeros(len(node) + 1, 5).index_add_(0, row, torch.cat(parts)))


def _look_up(grid: _Grid, position: Tensor, normal: Tensor) -> tuple[Tensor, Tensor]:
    """Radiance (P, 3) at points with unit normals (P, 3), and number of photons (P,) on the area of a node.

    Small and curved surfaces have only a part of a node's area in the layers around them.
    """
    axis = normal.abs().argmax(-1)
    node, weight = _nodes(position, normal, axis, grid.spacing, layers=2)
    row = torch.searchsorted(grid.node, node).clamp(max=len(grid.node) - 1)
    row = torch.where(grid.node[row] == node, row, len(grid.node))
    light = (grid.light[row] * weight[..., None]).sum(1)
    flux, count, area = light.split([3, 1, 1], 1)
    flat = grid.spacing**2 / normal.abs().gather(1, axis[:, None])
    area = torch.where(area > 0, torch.minimum(area, flat), flat)  # what lies on a surface takes no light from above it
    return flux / (math.pi * area), count[:, 0]


def _nodes(position: Tensor, normal: Tensor, axis: Tensor, spacing: float, layers: int) -> tuple[Tensor, Tensor]:
    """Nodes (P, 4 layers) around points (P, 3), as numbers (i64), and their weights, of sum 1 in each layer.

    Layers are stacked along an axis (P,). Nodes are where the plane of a point with its unit normal (P, 3) passes: in
    that layer, and if `layers` is 2, in the nearest other one.
    """
    turned = (axis[:, None] + torch.arange(3, device=axis.device)) % 3
    along, slope = normal.gather(1, turned).split([1, 2], 1)
    height, plane = position.gather(1, turned).split([1, 2], 1)
    corner, low = position.new_tensor([[0, 0], [0, 1], [1, 0], [1, 1]]), (plane / spacing).floor()
    share, cell = (plane / spacing - low)[:, None], low[:, None] + corner
    weight = torch.where(corner > 0, share, 1 - share).prod(-1)
    offset = cell * spacing - plane[:, None]
    height = (height - (offset * slope[:, None]).sum(-1) / along) / (THIN + THICKER * spacing)
    layer = height.floor()[..., None]
    if layers == 2:
        layer = torch.cat([layer, layer + torch.where(height[..., None] - layer < 0.5, -1.0, 1.0)], -1)
    (x, y), z = _to_integers(cell, BITS[0]).unbind(-1), _to_integers(layer, BITS[1])
    kind = 2 * axis[:, None] + (along > 0)
    in_layer = kind + 6 * ((x << BITS[0]) + y)
    return (in_layer[..., None] + (6 * z << 2 * BITS[0])).flatten(1), weight.repeat_interleave(layers, 1)


def _to_integers(coordinate: Tensor, bits: int) -> Tensor:
    """i64 from 0 on, clamped to so many bits."""
    half = 1 << bits - 1
    return coordinate.clamp(-half, half - 1).long() + half
