# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the patches that exchange light: triangles, large ones split, small ones merged, at most PATCHES."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ...geometry import area_vectors, quartered
from ...scene import BASE_COLOR, METALLIC, TRANSMISSION, RenderScene
from ..prior.blocking import is_solid, passes_light

PATCHES = 4096
NEAR = 0.5           # network units from the origin, half a side of the box that is looked at
AT_ONCE = 64         # triangles that are split before the largest are looked for again
TRANSMITTED = 0.5    # share of a glass's light that spreads to either side like a diffuse one
SPECULAR = 0.04      # what a dielectric reflects before its colour
FINEST = 0.02        # side of a cell near the origin whose triangles are one patch
COARSER = 2 ** 0.25  # than those of the cells that were too many


@dataclass
class Patches:
    """S patches of all triangles that are no lights, and the T triangles that they were split into."""

    center: Tensor   # (S, 3) f32
    vector: Tensor   # (S, 3) f32, area vectors
    albedo: Tensor   # (S, 3) f32
    patch: Tensor    # (T,) i64, row of the patch that a triangle belongs to
    corners: Tensor  # (T, 3, 3) f32
    solid: Tensor    # (T,) bool, stops light
    glass: Tensor    # (T,) bool, bends it
    tint: Tensor     # (T, 3) f32, mean base colour


def patches(scene: RenderScene) -> Patches:
    rows = np.flatnonzero(~scene.is_light)
    corners, source = _split(scene.triangles[rows])
    albedo = _albedo(scene)[scene.tile_index[rows]][source]
    center, vector, albedo = map(torch.from_numpy, (corners.mean(axis=1), area_vectors(corners), albedo))
    tint = scene.tiles[:, BASE_COLOR].mean(axis=(2, 3), dtype=np.float32)[scene.tile_index]
    passing = passes_light(scene)
    bending = passing & ~passes_light(scene, straight=True)
    solid, glass, tint = (torch.from_numpy(kind[rows][source]) for kind in (is_solid(scene) & ~passing, bending, tint))
    return Patches(*_merged(center, vector, albedo, glass), torch.from_numpy(corners), solid, glass, tint)


def _albedo(scene: RenderScene) -> np.ndarray:
    """(tiles, 3) share of the light that a tile's surface sends on, as if all of it were diffuse."""
    mean = scene.tiles.mean(axis=(2, 3), dtype=np.float32)
    base, metallic, transmission = mean[:, BASE_COLOR], mean[:, METALLIC, None], mean[:, TRANSMISSION, None]
    inside = (1 - transmission) + TRANSMITTED * transmission
    return base * (metallic + (1 - metallic) * (1 - SPECULAR) * inside) + SPECULAR * (1 - metallic)


def _split(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(S, 3, 3) corners with the triangles that look largest quartered, and (S,) rows where they come from.

    Points close to a large patch would see too little of it, and what is looked at is around the origin. There are
    PATCHES then, or that half as many more than before, which makes room for walls beside fine meshes that are merged
    afterwards.
    """
    source = np.arange(len(corners))
    wanted = max(PATCHES, len(corners) + PATCHES // 2) if len(corners) else 0
    while room := (wanted - len(corners)) // 3:
        size = _apparent_size(corners.mean(axis=1), np.linalg.norm(area_vectors(corners), axis=1))
        order = np.argsort(-size, kind="stable")
        large, rest = np.split(order, [min(room, AT_ONCE, np.count_nonzero(size > size.max() / 4))])
        corners = np.concatenate([corners[rest], quartered(corners[large])])
        source = np.concatenate([source[rest], np.tile(source[large], 4)])
    return corners, source


def _apparent_size(center: np.ndarray, area: np.ndarray) -> np.ndarray:
    """(S,) areas (S,) around centres (S, 3) over the squared distance from which the middle of the scene sees them."""
    distance = (np.linalg.norm(center, axis=1) - np.sqrt(area)).clip(NEAR)
    return area / distance**2


def _merged(center: Tensor, vector: Tensor, albedo: Tensor, glass: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The same of groups of triangles that face the same way in the same cell, glass by itself; far cells are large.

    The centroid is that of the largest triangle of a group. And which group each of the (S,) triangles is in.
    """
    if len(center) <= PATCHES:
        return center, vector, albedo, torch.arange(len(center))
    group, count = _groups(center, vector, glass)
    area = vector.norm(dim=-1, keepdim=True)
    size = area[:, 0]

    def summed(x: Tensor) -> Tensor:
        return torch.zeros(count, x.shape[-1]).index_add_(0, group, x)

    # In the middle of its largest part a group is on a surface, and not between two with a lamp in between.
    largest = torch.zeros(count).scatter_reduce_(0, group, size, "amax")
    middle = torch.zeros(count, 3)
    middle[group[size >= largest[group]]] = center[size >= largest[group]]
    return middle, summed(vector), summed(area * albedo) / summed(area).clamp_min(1e-20), group


def _groups(center: Tensor, vector: Tensor, glass: Tensor) -> tuple[Tensor, int]:
    """Which group each of the (S,) triangles is in, and how many there are: PATCHES at most, of the finest cells.

    A triangle's group depends on nothing but its own place and side: light does not flicker when another one moves.
    """
    axis = vector.abs().argmax(1, keepdim=True)
    kind = (2 * axis + (vector.gather(1, axis) < 0))[:, 0] + 6 * glass
    level = (2 * (center.norm(dim=-1) / NEAR).clamp_min(1).log2()).floor()
    cell = FINEST
    while True:
        place = (center / (cell * 2 ** (level / 2))[:, None]).floor()
        names = torch.cat([place, level[:, None], kind[:, None]], 1).long()
        found, group = names.unique(dim=0, return_inverse=True)
        if len(found) <= PATCHES:
            return group, len(found)
        cell *= COARSER
