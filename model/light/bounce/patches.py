# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the patches that exchange light: triangles, large ones split, small ones merged, at most PATCHES.

They are small where the scene's middle or a lamp is near.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...geometry import area_vectors, quartered, surfaces
from ...material.reflectance import blurred, layer_reflectance, normal_reflectance
from ...scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene, tint_of_glass
from ..direct.direct_light import Lamps
from ..occluders import bends_light, is_solid, passes_light
from ..sampling import R2, scattered, triangle_weights
from .openness import Openness

PATCHES = 4096
NEAR = 0.5           # network units from the origin, half a side of the box that is looked at
NEAR_LAMP = 0.03     # network units from a lamp: what is closer needs no smaller patches
BY_LAMPS = 0.5       # of all patches, how many go by lamps
AT_ONCE = 64         # triangles that are split before the largest are looked for again
TRANSMITTED = 0.5    # share of a glass's light that spreads to either side like a diffuse one
STEEP = 0.7          # of the glossy light of metals: lamps light most surfaces more steeply than all around does
FINEST = 0.008       # side of a cell whose triangles are one patch, where a unit of area gets all
CUT = 0.5            # of all patches, how many more triangles there may be where walls cut through them
CRUMBS = 8           # groups that a surface must be of by itself to share none with others
COARSER = 2 ** 0.25  # than those of the cells that were too many


@dataclass
class Patches:
    """S patches of all triangles that are no lights, and the T triangles that they were split into."""

    center: Tensor   # (S, 3) f32
    vector: Tensor   # (S, 3) f32, area vectors
    albedo: Tensor   # (S, 9) f32, RGB of the diffuse lobe, of metals, and of the layers of dielectrics
    layer: Tensor    # (S, 2) f32, reflectance at normal incidence and perceptual roughness of these
    patch: Tensor    # (T,) i64, row of the patch that a triangle belongs to
    corners: Tensor  # (T, 3, 3) f32
    solid: Tensor    # (T,) bool, stops light
    glass: Tensor    # (T,) bool, bends it
    tint: Tensor     # (T, 3) f32, share of the light that passes
    weight: Tensor   # (S,) f32, areas, the larger the nearer to the scene's middle and the lamps

    def points(self, count: int) -> tuple[Tensor, Tensor]:
        """(S, count, 3) places spread over the fronts of the patches by area, and their unit normals."""
        vector = torch.from_numpy(area_vectors(self.corners.numpy()))
        order = self.patch.argsort(stable=True)
        filled = vector.norm(dim=-1)[order].double().cumsum(0)  # area up to the end of each triangle, patch by patch
        ends = filled[self.patch[order].bincount(minlength=len(self.center)).cumsum(0) - 1]
        begins = F.pad(ends[:-1], (1, 0))
        start = scattered(self.center, 3)
        k = torch.arange(count)
        share = (k + start[:, :1]) / count
        row = torch.searchsorted(filled, begins[:, None] + share * (ends - begins)[:, None])
        triangle = order[row.clamp(max=len(order) - 1)]
        u, v = ((k * step + start[:, i + 1:i + 2]) % 1 for i, step in enumerate(R2))
        normal = F.normalize(vector[triangle], dim=-1)
        facing = (normal * self.vector[:, None]).sum(-1, keepdim=True)
        weights = triangle_weights(u, v)[..., None]
        return (weights * self.corners[triangle]).sum(2), torch.where(facing < 0, -normal, normal)


def patches(scene: RenderScene, lamps: Lamps, share: float = 1.0, openness: Openness | None = None) -> Patches:
    """share: how many of PATCHES there are at most. With `openness` none is on both sides of a wall."""
    most = round(share * PATCHES)
    rows = np.flatnonzero(~scene.is_light)
    corners, source = _split(scene.triangles[rows], lamps, most)
    if openness:
        corners, source = openness.cut(corners, source, round(CUT * most))
    means = scene.tiles.mean(axis=(2, 3), dtype=np.float32)
    material = np.concatenate([_albedo(means), _layer(means)], axis=1)[scene.tile_index[rows]][source]
    center, vector, material = map(torch.from_numpy, (corners.mean(axis=1), area_vectors(corners), material))
    tint, passing = _tint(means)[scene.tile_index], passes_light(scene)
    solid, glass, tint = (torch.from_numpy(of[rows][source]) for of in (
        is_solid(scene) & ~passing, bends_light(scene), tint))
    surface = torch.from_numpy(surfaces(scene.triangles[rows])[source])
    kind = glass + 2 * torch.from_numpy(openness.kinds(corners)) if openness else glass.long()
    center, vector, material, patch = _merged(center, vector, material, kind, surface, lamps, most)
    weight = vector.norm(dim=-1) * torch.from_numpy(nearness(center.numpy(), lamps)).float()
    return Patches(center, vector, *material.split([9, 2], 1), patch, torch.from_numpy(corners), solid, glass, tint,
                   weight)


def _tint(means: np.ndarray) -> np.ndarray:
    """(tiles, 3) share of the light that the surfaces of tiles let through, from the means of these, (tiles, C)."""
    return (1 - means[:, METALLIC, None]) * means[:, TRANSMISSION, None] * tint_of_glass(means[:, BASE_COLOR])


def _albedo(means: np.ndarray) -> np.ndarray:
    """(tiles, 9) share of the light that the surfaces of tiles send on, RGB each, from the same.

    By the diffuse lobe, by that of metals, and by the layers of dielectrics, of light from everywhere.
    """
    base, metallic, transmission = means[:, BASE_COLOR], means[:, METALLIC, None], means[:, TRANSMISSION, None]
    inside = (1 - transmission) + TRANSMITTED * transmission
    passed, layer = (layer_reflectance(means[:, IOR, None], roughness) for roughness in
                     (means[:, ROUGHNESS, None], blurred(means[:, ROUGHNESS, None])))
    diffuse = (1 - metallic) * (1 - passed) * base * inside
    return np.concatenate([diffuse, metallic * base, np.repeat((1 - metallic) * layer, 3, axis=1)], axis=1)


def _layer(means: np.ndarray) -> np.ndarray:
    """(tiles, 2), as of Patches, from the same."""
    return np.stack([normal_reflectance(means[:, IOR].clip(1)), blurred(means[:, ROUGHNESS])], axis=1)


def _split(corners: np.ndarray, lamps: Lamps, most: int) -> tuple[np.ndarray, np.ndarray]:
    """(S, 3, 3) corners with the triangles that look largest quartered, and (S,) rows where they come from.

    Points close to a large patch would see too little of it, and what is looked at is around the origin. There are
    `most` then, or that half as many more than before, which makes room for walls beside fine meshes that are merged
    afterwards.
    """
    source = np.arange(len(corners))
    wanted = max(most, len(corners) + most // 2) if len(corners) else 0
    while room := (wanted - len(corners)) // 3:
        area = np.linalg.norm(area_vectors(corners), axis=1)
        size = area * nearness(corners.mean(axis=1), lamps, np.sqrt(area))
        order = np.argsort(-size, kind="stable")
        large, rest = np.split(order, [min(room, AT_ONCE, np.count_nonzero(size > size.max() / 4))])
        corners = np.concatenate([corners[rest], quartered(corners[large])])
        source = np.concatenate([source[rest], np.tile(source[large], 4)])
    return corners, source


def nearness(place: np.ndarray, lamps: Lamps, size: np.ndarray | float = 0.0) -> np.ndarray:
    """(S,) patches, of one in all, that a unit of area gets around places (S, 3), if they were all around.

    So many as the scene's middle and the lamps see of it. What is of this `size` (S,) reaches as much nearer to them.
    """
    def seen(distance: np.ndarray, nearest: float) -> np.ndarray:
        return 1 / (4 * np.pi * (distance - size).clip(nearest) ** 2)

    found = seen(np.linalg.norm(place, axis=1), NEAR)
    if not len(lamps.share):
        return found
    lit = sum(share * seen(np.linalg.norm(place - at, axis=1), NEAR_LAMP) for at, share in zip(*lamps, strict=True))
    return (1 - BY_LAMPS) * found + BY_LAMPS * lit


def _merged(center: Tensor, vector: Tensor, material: Tensor, kind: Tensor, surface: Tensor, lamps: Lamps,
            most: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The same of groups of triangles that face the same way in the same cell, each `kind` and surface alone.

    The centroid is that of the largest triangle of a group. And which group each of the (S,) triangles is in.
    """
    if len(center) <= most:
        return center, vector, material, torch.arange(len(center))
    group, count = _groups(center, vector, kind, surface, lamps, most)
    area = vector.norm(dim=-1, keepdim=True)
    size = area[:, 0]

    def summed(x: Tensor) -> Tensor:
        return torch.zeros(count, x.shape[-1]).index_add_(0, group, x)

    # In the middle of its largest part a group is on a surface, and not between two with a lamp in between. Of several
    # as large it is the first: whichever thread comes last would decide otherwise.
    largest = torch.zeros(count).scatter_reduce_(0, group, size, "amax")
    rows = (size >= largest[group]).nonzero()[:, 0]
    middle = center[torch.full((count,), len(center)).scatter_reduce_(0, group[rows], rows, "amin")]
    return middle, summed(vector), summed(area * material) / summed(area).clamp_min(1e-20), group


def _groups(center: Tensor, vector: Tensor, kind: Tensor, surface: Tensor, lamps: Lamps,
            most: int) -> tuple[Tensor, int]:
    """Which group each of the (S,) triangles is in, and how many there are: `most` or fewer, of the finest cells.

    What stands on a thin floor is no group with its underside: surfaces are together only if they are CRUMBS. A
    triangle's group depends on nothing but its own surface, place and side: light does not flicker when another moves.
    """
    axis = vector.abs().argmax(1, keepdim=True)
    kind = (2 * axis + (vector.gather(1, axis) < 0))[:, 0] + 6 * kind
    density = torch.from_numpy(nearness(center.numpy(), lamps)).float()
    level = -density.log2().round()
    cell, count = FINEST, int(surface.max()) + 1
    while True:
        place = (center / (cell * 2 ** (level / 2))[:, None]).floor()
        _, shared = torch.cat([place, level[:, None], kind[:, None]], 1).long().unique(dim=0, return_inverse=True)
        own, group = (shared * count + surface).unique(return_inverse=True)
        crumb = (own % count).bincount(minlength=count)[surface] < CRUMBS
        found, group = torch.where(crumb, -1 - shared, group).unique(return_inverse=True)
        if len(found) <= most:
            return group, len(found)
        cell *= COARSER
