# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands between a light and a point, by shadow maps (Williams 1978, "Casting curved shadows on curved surfaces").

A map keeps, cell by cell, how far from the light the nearest of many points lies that are strewn over the triangles.
"""
from __future__ import annotations

import math
from functools import partial

import torch
from torch import Tensor
from torch.nn import functional as F

from ...geometry import quartered
from ...threads import shared

SIDES = 128, 512  # cells along a map, at least and at most
DENSITY = 3.0     # points per cell of a surface that faces a distant light
POINTS = 1 << 22  # of all maps together, at most
SPLITS = 24       # times that a triangle is quartered, at most
NEAR = 2.0        # network units from the centre within which shadows are cast: a map of a large ground is too coarse
GOLDEN = (math.sqrt(5) - 1) / 2


class ShadowMaps:
    """One map for each of several lights."""

    def __init__(self, triangles: Tensor, lights: Tensor):
        """triangles: (T, 3, 3) corners of what casts shadows, network units; lights: (L, 3)."""
        triangles, _ = parts_near(triangles, NEAR)
        corners = triangles.reshape(-1, 3).clamp(-NEAR, NEAR)
        low, high = (corners.amin(0), corners.amax(0)) if len(corners) else corners.new_zeros(2, 3)
        self.lights, self.center, self.radius = lights, (low + high) / 2, max((high - low).norm().item() / 2, 1e-6)
        most = POINTS // max(len(lights), 1)
        cells = 4 * self.radius**2 * most / (DENSITY * areas(triangles).sum().item() + 1e-12)  # of so many points
        self.side = min(max(1 << int(math.log2(cells) / 2), SIDES[0]), SIDES[1])
        points, _ = surface_points(triangles, (2 * self.radius / self.side) ** 2 / DENSITY, most)
        points = points[(points - self.center).norm(dim=-1) <= self.radius]
        rows = torch.arange(len(lights), device=lights.device).split(1)
        self.nearest = torch.cat(shared(partial(self._drawn, points[:, None]), rows))

    def _drawn(self, points: Tensor, which: Tensor) -> Tensor:
        """(L, side^2) distance to the nearest of points (P, 1, 3) in the cells of some lights' maps."""
        cell, distance = self.project(points, which)
        nearest = torch.full((len(which), self.side * self.side), math.inf, device=points.device)
        return nearest.scatter_reduce_(1, cell.T, distance.T, "amin")

    def __call__(self, position: Tensor, normal: Tensor) -> Tensor:
        """(P, L) bool, which lights see the points (P, 3) of surfaces with unit normals (P, 3)."""
        # A cell's width off its surface, a point is not shaded by what else the cell holds of that surface.
        lifted = position[:, None] + normal[:, None] * self.pitch(position)[..., None]
        cell, distance = self.project(lifted, slice(None))
        return distance <= self.nearest.T.gather(0, cell)

    def project(self, points: Tensor, which: slice | Tensor) -> tuple[Tensor, Tensor]:
        """Cells and distances (P, L) of points (P, 1 or L, 3) in the maps of some lights."""
        raise NotImplementedError

    def pitch(self, position: Tensor) -> Tensor:
        """(P, 1 or L) width of a cell at points (P, 3)."""
        raise NotImplementedError

    def cell(self, right: Tensor, up: Tensor) -> Tensor:
        """Cells of places on the maps, from -1 to 1 along both sides."""
        column, row = (((a + 1) * (self.side / 2)).long().clamp_(0, self.side - 1) for a in (right, up))
        return row * self.side + column


class DistantShadows(ShadowMaps):
    """Of lights infinitely far away in unit directions (L, 3)."""

    def project(self, points: Tensor, which: slice | Tensor) -> tuple[Tensor, Tensor]:
        towards = self.lights[which]
        aside = F.normalize(torch.linalg.cross(towards, towards.roll(1, dims=-1)), dim=-1)
        offset = (points - self.center) / self.radius
        axes = aside, torch.linalg.cross(towards, aside), towards
        right, up, height = ((offset @ axis.T).squeeze(1) for axis in axes)
        outside = torch.maximum(right.abs(), up.abs()) > 1 + 1e-4
        return self.cell(right, up), torch.where(outside, -math.inf, -height)

    def pitch(self, position: Tensor) -> Tensor:
        return torch.full_like(position[:, :1], math.sqrt(8) * self.radius / self.side)  # from corner to corner


class LampShadows(ShadowMaps):
    """Of lights at points (L, 3), which look around in octahedral maps."""

    def project(self, points: Tensor, which: slice | Tensor) -> tuple[Tensor, Tensor]:
        offset = points - self.lights[which]
        x, y, z = (offset / offset.abs().sum(-1, keepdim=True).clamp_min(1e-12)).unbind(-1)
        right = torch.where(z < 0, torch.copysign(1 - y.abs(), x), x)
        up = torch.where(z < 0, torch.copysign(1 - x.abs(), y), y)
        return self.cell(right, up), offset.norm(dim=-1)

    def pitch(self, position: Tensor) -> Tensor:
        return 8 * math.sqrt(3) / self.side * torch.cdist(position, self.lights)  # the widest cells are this wide


def areas(triangles: Tensor) -> Tensor:
    """(T,) of (T, 3, 3)."""
    a, b, c = triangles.unbind(1)
    return torch.linalg.cross(b - a, c - a).norm(dim=-1) / 2


def surface_points(triangles: Tensor, area: float, limit: int) -> tuple[Tensor, Tensor]:
    """(N, 3) points on (T, 3, 3) triangles, and their rows (N,).

    One per started `area` of each, or of so much more that N <= limit + T.
    """
    size = areas(triangles)
    count = (size / max(area, size.sum().item() / limit)).ceil().long()
    row = torch.repeat_interleave(count)
    k = torch.arange(len(row), device=row.device) - (count.cumsum(0) - count)[row]
    u, v = ((k + 0.5) / count[row]).sqrt(), (k.double() * GOLDEN % 1).float()  # a Fibonacci lattice
    return torch.stack([1 - u, u * (1 - v), u * v], dim=1)[:, None].matmul(triangles[row])[:, 0], row


def parts_near(triangles: Tensor, half: float) -> tuple[Tensor, Tensor]:
    """Triangles (T, 3, 3) that may reach into a box, large ones as smaller parts, and their rows (T,)."""
    source = torch.arange(len(triangles), device=triangles.device)
    for _ in range(SPLITS):
        low, high = triangles.amin(1), triangles.amax(1)
        near = ((low < half) & (high > -half)).all(1)
        triangles, source, size = triangles[near], source[near], (high - low)[near].amax(1)
        large = size > half
        if not large.any():
            break
        triangles = torch.cat([triangles[~large], quartered(triangles[large])])
        source = torch.cat([source[~large], source[large].repeat(4)])
    return triangles, source
