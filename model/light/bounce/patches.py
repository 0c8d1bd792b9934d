# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the patches that exchange light: real triangles, large ones split, small ones merged, at most PATCHES.

They are small near the scene's middle and near emitters.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from ...clusters import groups_of
from ...geometry import area_vectors, surfaces
from ...material.reflectance import blurred, normal_reflectance
from ...scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene, tile_means
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING, BOUNCED, REFLECTING, SOLID, STRAIGHT_THROUGH, Kind, clear_tiles, is_kind
from ..direct.emitter_light import NearEmitters
from ..fresnel import layer_albedo, single_scattering
from .grouping import group_elements, group_patches
from .openness import Openness
from .slices import slice_counts
from .subdivision import PieceLocator, Subdivision

PATCHES = 1 << 15
NEAR = 0.5           # network units from the origin within which patches get no smaller: half a side of the box
NEAR_EMITTER = 0.03  # the same from an emitter
BY_EMITTERS = 0.5    # share of all patches that is distributed by the distance to emitters
SPLIT_AT_ONCE = 512  # triangles that are split before the largest are searched again
TRANSMITTED = 0.5    # share of a glass's light that spreads to either side like that of a diffuse lobe
LEAST_SOLID = 0.02   # share that does not pass straight, of a surface that light passes straight
STEEP = 0.7          # of the glossy light of metals: emitters light most surfaces more steeply than uniform light
REGULAR = 3 ** 0.5 / 4  # area of a triangle with three sides of length 1
LONG = 0.25          # how far a long triangle counts as a regular one of its length, not of its area
CUT = 0.5            # triangles that may be added where walls cut through others, as a share of the patches


@dataclass
class Patches:
    """S patches of all surfaces that reflect light, and the T triangles that these were split into."""

    center: Tensor   # (S, 3) f32
    vector: Tensor   # (S, 3) f32, area vectors
    albedo: Tensor   # (S, 9) f32, RGB of the diffuse lobe, of metal, and of the layer of a dielectric
    layer: Tensor    # (S, 2) f32, f0 and perceptual roughness of that layer, which Cycles blurs
    back_albedo: Tensor  # (S, 9) f32, the same of their backs
    back_layer: Tensor   # (S, 2) f32
    translucent: Tensor  # (S, 3) f32, share of the diffuse light that goes to the other side
    glow: Tensor     # (S, 3) f32, radiance of their own
    patch: Tensor    # (T,) i64, row of the patch that a triangle belongs to
    corners: Tensor  # (T, 3, 3) f32
    normals: Tensor  # (T, 3, 3) f32, shading normals at the corners
    height: Tensor   # (T, 3) f32, of the curved surface above the corners (direct/terminator.py)
    solid: Tensor    # (T,) bool, stops light that does not pass it straight
    group: np.ndarray  # (S,) u8, of surfaces (RenderScene.group)
    weight: Tensor   # (S,) f32, area, weighted by how near the scene's middle and the emitters are
    locator: PieceLocator  # of the T triangles

    @cached_property
    def turned(self) -> Tensor:
        """(T, 1) -1 for triangles whose back is on the front of their patch, 1 for all others."""
        along = (self._vectors * self.vector[self.patch]).sum(-1, keepdim=True)
        return torch.where(along < 0, -1.0, 1.0)

    @cached_property
    def facing(self) -> Tensor:
        """(T, 3) area vectors of the triangles, on the front of their patch."""
        return self.turned * self._vectors

    @cached_property
    def _vectors(self) -> Tensor:
        return torch.from_numpy(area_vectors(self.corners.numpy()))


def make_patches(scene: RenderScene, emitters: NearEmitters, share: float = 1.0,
                 openness: Openness | None = None) -> Patches:
    """At most `share` of PATCHES patches of a normalised scene; with `openness` none is on both sides of a wall, and
    there may be half as many more."""
    most = round(share * PATCHES)
    kinds = scene_rays(scene).trees.kinds
    means = _solid_means(scene)
    material = np.concatenate([tile_albedo(means, scene.of_tiles("single")), _layer(means)], axis=1)
    shines = is_kind(kinds, Kind.EMITTER)
    rows = scene_rays(scene).rows(REFLECTING, BOUNCED)
    is_black = ~material[:, :9].any(axis=1)[scene.tile_index[scene.surfaces.token[rows]]]
    subdivision = Subdivision(scene.surfaces.triangles, rows[~(shines[rows] & is_black)])
    _split(subdivision, emitters, shines, most)
    if openness:
        openness.cut(subdivision, round(CUT * most))
        most += round(CUT * most)
    corners, source = subdivision.pieces()
    token = scene.surfaces.token[source]
    material = np.concatenate([material[scene.tile_index], material[scene.tile_behind],
                               scene.of_tiles("translucent")[scene.tile_index], scene.surface_glow], axis=1)
    density = patch_density(scene.triangles.mean(axis=1), emitters, scene.is_light)
    element, largest = group_elements(corners, token, density)
    vector = _sums(area_vectors(corners), element)
    center, token = corners[largest].mean(axis=1), token[largest]
    solid, glass = (is_kind(kinds[source], some) for some in (SOLID | STRAIGHT_THROUGH | Kind.EMITTER, BENDING))
    is_open = openness.kinds(corners[largest]) if openness and len(center) > most else np.zeros(len(center), np.int64)
    group = scene.seldom("group")[token]
    apart = is_open + (is_open.max(initial=0) + 1) * group  # no patch is of two groups
    shines = shines[source][largest]
    center, vector, material, patch = _merge(*map(torch.from_numpy, (
        center, vector, material[token], glass[largest], shines, apart, surfaces(scene.triangles)[token])), emitters,
        most)
    group_of_patch, patch_shines = np.zeros(len(center), np.uint8), np.zeros(len(center), bool)
    group_of_patch[patch.numpy()], patch_shines[patch.numpy()] = group, shines
    density = patch_density(center.numpy(), emitters, patch_shines)
    weight = vector.norm(dim=-1) * torch.from_numpy(density).float()
    return Patches(center, vector, *material.split([9, 2, 9, 2, 3, 3], 1), patch[torch.from_numpy(element)],
                   torch.from_numpy(corners), torch.from_numpy(subdivision.interpolated(scene.surfaces.normals)),
                   subdivision.heights(scene.surfaces.normals),
                   torch.from_numpy(solid), group_of_patch, weight, subdivision.locator())


def _sums(values: np.ndarray, group: np.ndarray) -> np.ndarray:
    """(E, C) f32 sums of values (T, C) by their group (T,)."""
    return np.stack([np.bincount(group, column) for column in values.T], axis=1).astype(np.float32)


def _solid_means(scene: RenderScene) -> np.ndarray:
    """(T, 11) mean parameters of tiles; where light passes straight, of the rest."""
    means = tile_means(scene.tiles)
    clear = clear_tiles(scene)
    is_clear, share = clear.any(axis=1), clear.mean(axis=1)
    means[:, BASE_COLOR] -= clear
    means[:, IOR] -= share  # which is 1 where nothing bends
    means[is_clear] /= (1 - share[is_clear, None]).clip(LEAST_SOLID)
    for shares in (BASE_COLOR, METALLIC, ROUGHNESS):
        means[is_clear, shares] = means[is_clear, shares].clip(0, 1)
    means[is_clear, TRANSMISSION] = 0
    return means


def tile_albedo(means: np.ndarray, single: np.ndarray) -> np.ndarray:
    """(tiles, 11) mean parameters, (tiles,) `single` of RenderScene -> (tiles, 9) albedo for uniform light: RGB of the
    diffuse lobe, of metal, of a dielectric's layer."""
    base, metallic, transmission = means[:, BASE_COLOR], means[:, METALLIC, None], means[:, TRANSMISSION, None]
    inside = (1 - transmission) + TRANSMITTED * transmission
    f0, roughness = map(torch.from_numpy, _layer(means).T)
    own, sent = (layer_albedo(f0, roughness, facets)[:, None].numpy() for facets in (None, blurred(roughness)))
    diffuse = (1 - metallic) * (1 - own) * base * inside
    once = single_scattering(torch.from_numpy(base), roughness).numpy()
    metal = metallic * base * (1 + single[:, None] * (once - 1))
    return np.concatenate([diffuse, metal, np.repeat((1 - metallic) * sent, 3, axis=1)], axis=1)


def _layer(means: np.ndarray) -> np.ndarray:
    """(tiles, 2) as Patches.layer, of the same."""
    return np.stack([normal_reflectance(means[:, IOR].clip(1)), means[:, ROUGHNESS]], axis=1)


def _split(subdivision: Subdivision, emitters: NearEmitters, shines: np.ndarray, most: int) -> None:
    """Slice needles, and quarter the triangles that look largest: a large patch would light points close to it wrongly.

    There are `most` triangles then, or `most` / 2 more than before if that is more, which leaves room for walls beside
    fine meshes that are merged afterwards. shines: (G,) bool, triangles that are emitters themselves.
    """
    count = len(subdivision.corners)
    target = max(most, count + most // 2) if count else 0
    area = np.linalg.norm(area_vectors(subdivision.corners), axis=1)
    density = patch_density(subdivision.corners.mean(axis=1), emitters, shines[subdivision.source], np.sqrt(area))
    subdivision.slice(slice_counts(subdivision.corners, area * density, density, target))
    size = _apparent_size(subdivision.corners, emitters, shines[subdivision.source])
    while (room := (target - len(size)) // 3) > 0:  # slices may be more than there is room for
        order = np.argsort(-size, kind="stable")
        large = order[:min(room, SPLIT_AT_ONCE, np.count_nonzero(size > size.max() / 4))]
        fresh = subdivision.quarter(large)
        if not len(fresh):
            break
        of_fresh = _apparent_size(subdivision.corners[fresh], emitters, shines[subdivision.source[fresh]])
        size = np.concatenate([np.delete(size, large), of_fresh])
        size[subdivision.is_deepest] = 0


def _apparent_size(corners: np.ndarray, emitters: NearEmitters, shines: np.ndarray) -> np.ndarray:
    """(S,) share of all patches that triangles (S, 3, 3) should get: more for long ones than for others."""
    area = np.linalg.norm(area_vectors(corners), axis=1)
    length2 = np.square(corners - np.roll(corners, 1, axis=1)).sum(axis=-1).max(axis=1)
    size = area ** (1 - LONG) * (REGULAR * length2) ** LONG
    return size * patch_density(corners.mean(axis=1), emitters, shines, np.sqrt(size))


def patch_density(position: np.ndarray, emitters: NearEmitters, shines: np.ndarray,
                  size: np.ndarray | float = 0.0) -> np.ndarray:
    """(S,) share of all patches that a unit of area gets at positions (S, 3): its solid angle / 4 pi.

    As seen from the scene's middle and from emitters, unless it shines (S,) itself. Surfaces of a `size` (S,) reach
    nearer by as much.
    """
    def solid_angle(distance: np.ndarray, nearest: float) -> np.ndarray:
        return 1 / (4 * np.pi * (distance - size).clip(nearest) ** 2)

    from_middle = solid_angle(np.linalg.norm(position, axis=1), NEAR)
    if not len(emitters.power_share):
        return from_middle
    from_emitters = sum(share * solid_angle(np.linalg.norm(position - at, axis=1), NEAR_EMITTER)
                        for at, share in zip(*emitters, strict=True))
    return (1 - BY_EMITTERS) * from_middle + BY_EMITTERS * np.where(shines, 0, from_emitters)


def _merge(center: Tensor, vector: Tensor, material: Tensor, glass: Tensor, shines: Tensor, openness: Tensor,
           surface: Tensor, emitters: NearEmitters, most: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Centre, area vector and material of groups of elements, as of `group_patches`.

    The centre is that of the largest element of a group. Also returns the group of each of the (E,) elements.
    """
    if len(center) <= most:
        return center, vector, material, torch.arange(len(center))
    kind = glass + 2 * shines
    density = patch_density(center.numpy(), emitters, shines.numpy())
    group, count = group_patches(*(x.numpy() for x in (center, vector, kind, openness, surface)), density, most)
    group = torch.from_numpy(group)
    area = vector.norm(dim=-1, keepdim=True)

    def summed(x: Tensor) -> Tensor:
        return torch.zeros(count, x.shape[-1]).index_add_(0, group, x)

    # The middle of its largest triangle is on a surface, not between two with a lamp in between.
    middle = center[torch.from_numpy(groups_of(group.numpy(), area[:, 0].numpy())[1])]
    return middle, summed(vector), summed(area * material) / summed(area).clamp_min(1e-20), group
