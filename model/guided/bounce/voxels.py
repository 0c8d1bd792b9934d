# SPDX-License-Identifier: GPL-3.0-or-later
"""Which triangle a ray meets first, on nested voxel grids around the origin.

A voxel keeps one of its triangles, whose plane the ray must cross there (Amanatides and Woo 1987 walk such grids voxel
by voxel; here a distance field says how far a ray may leap, Zuiderveld et al. 1992). Good for light that spreads, not
for pictures: what is smaller than a voxel, or nearer than one, may be missed.
"""
from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ...threads import shared
from ..prior.shadow_maps import parts_near, surface_points

SIDE = 64                       # voxels along a grid
HALVES = (0.6, 2.4, 9.6, 38.4)  # half the side of each grid, network units
SPACING = 0.6                   # voxels between the points that find a triangle's voxels
POINTS = 1 << 21                # of a grid, at most
LEAP = 6                        # voxels, at most
STEP = 0.7                      # voxels, at least
NEAR = 0.6                      # voxels: what a ray meets before is the surface that it leaves
STEPS = 96                      # of a ray, at most
CHUNK = 1 << 15                 # rays at a time
DONE = 1e4                      # where rays wait whose walk is over, network units
TOGETHER = 4                    # steps between two looks at which rays go on


class Voxels:
    """Of triangles (T, 3, 3), network units."""

    def __init__(self, triangles: Tensor):
        self.center = triangles.mean(1)
        self.normal = F.normalize(torch.linalg.cross(*(triangles[:, 1:] - triangles[:, :1]).unbind(1)), dim=-1)
        self.radius = (triangles - self.center[:, None]).norm(dim=-1).amax(1)
        self.pitch = triangles.new_tensor(HALVES) * (2 / SIDE)
        self.triangle = torch.cat(shared(self._filled, [triangles] * len(HALVES), HALVES))
        self.leap = _distance(self.triangle.view(-1, SIDE, SIDE, SIDE) == -1).view(-1)

    def __call__(self, origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
        """Triangle (P,), -1 if none, and distance (P,) met from points (P, 3) along unit directions (P, 3)."""
        found, distance = zip(*shared(self._walk, origin.split(CHUNK), direction.split(CHUNK)))
        return torch.cat(found), torch.cat(distance)

    def _walk(self, origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
        found = torch.full(origin.shape[:1], -1, device=origin.device)
        distance = torch.zeros_like(origin[:, 0])
        ray = torch.arange(len(origin), device=origin.device)
        t = self._place(origin)[1]  # a voxel off
        for step in range(STEPS):
            index, pitch, outside = self._place(torch.addcmul(origin, direction, t[:, None]))
            leap = self.leap.index_select(0, index)
            met = ((leap == 0) & ~outside).nonzero()[:, 0]
            if len(met):
                triangle = self.triangle.index_select(0, index.index_select(0, met)).long()
                at = self._crossing(triangle, *(x.index_select(0, met) for x in (origin, direction, t, pitch)))
                hit = at > 0
                found[ray[met[hit]]], distance[ray[met[hit]]] = triangle[hit], at[hit]
                outside[met[hit]] = True  # done
            t = t + (leap - 1).clamp_min(STEP) * pitch
            t.masked_fill_(outside, DONE)
            if step % TOGETHER == TOGETHER - 1:
                on = (t < DONE).nonzero()[:, 0]
                if not len(on):
                    break
                origin, direction, t, ray = (x.index_select(0, on) for x in (origin, direction, t, ray))
        return found, distance

    def _place(self, points: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Index into all grids' voxels, a voxel's side and whether they lie outside, (P,) each, of points (P, 3)."""
        far = points.abs().amax(-1)
        level = sum((far >= half).int() for half in HALVES[:-1])
        pitch = self.pitch.index_select(0, level)
        x, y, z = (points / pitch[:, None] + SIDE / 2).clamp_(0, SIDE - 1).int().unbind(1)
        return ((level * SIDE + x) * SIDE + y) * SIDE + z, pitch, far >= HALVES[-1]

    def _crossing(self, triangle: Tensor, origin: Tensor, direction: Tensor, t: Tensor, pitch: Tensor) -> Tensor:
        """(P,) distance at which rays cross their triangles' planes; 0 if not here, or beside the triangle."""
        normal, center, radius = (x.index_select(0, triangle) for x in (self.normal, self.center, self.radius))
        offset = center - origin
        at = (normal * offset).sum(-1) / (normal * direction).sum(-1)
        aside = (direction * at[:, None] - offset).norm(dim=-1)
        here = ((at - t).abs() <= pitch) & (at > NEAR * pitch) & (aside <= radius + pitch / 2)
        return torch.where(here, at, torch.zeros_like(at))

    def _filled(self, triangles: Tensor, half: float) -> Tensor:
        """(SIDE^3,) i32 triangle in each voxel of a grid, -1 where there is none."""
        grid = torch.full((SIDE ** 3,), -1, dtype=torch.int32, device=triangles.device)
        triangles, source = parts_near(triangles, half)
        points, row = surface_points(triangles, (SPACING * 2 * half / SIDE) ** 2, POINTS)
        inside = (points.abs() < half).all(1)
        x, y, z = ((points[inside] / half + 1) * (SIDE / 2)).long().clamp_(0, SIDE - 1).unbind(1)
        index = (x * SIDE + y) * SIDE + z
        return grid.scatter_reduce_(0, index, source[row[inside]].int(), "amax")


def _distance(empty: Tensor) -> Tensor:
    """(G, S, S, S) f32 voxels along an axis, at most LEAP, to the next of its grid that is full or outside."""
    distance = torch.zeros_like(empty, dtype=torch.float32)
    reached = F.pad(~empty, (1,) * 6, value=True)
    for _ in range(LEAP):
        distance += ~reached[:, 1:-1, 1:-1, 1:-1]
        for axis in (1, 2, 3):
            before, length = reached.clone(), reached.shape[axis] - 1
            for to, source in ((0, 1), (1, 0)):
                reached.narrow(axis, to, length).logical_or_(before.narrow(axis, source, length))
    return distance
