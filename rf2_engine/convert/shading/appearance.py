# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays of each kind meet of a material: bounced light, cameras, mirrors and shadow rays, from either side."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....model.scene import constant_tile
from ....model.surface_kinds import THIN, Ray
from ..data.blocks import Material
from ..data.copied import Instance
from ..data.mesh import TriangleMesh
from ..data.report import Report
from .material_tiles import CLEAR, EXTRAS, OPAQUE, MaterialTiles

# What cameras or shadow rays alone meet is none to bounced light, and so to the network.
WINDOW = constant_tile(base_color=(1, 1, 1), roughness=0, ior=1, transmission=1)
CLEAR_EXTRAS = OPAQUE.copy()
CLEAR_EXTRAS[EXTRAS["clear"]] = 1
OTHER_RAYS = {Ray.GLOSSY: CLEAR, Ray.TRANSMISSION: CLEAR, Ray.SCATTER: CLEAR, Ray.SHADOW: THIN}  # clear from
MIRRORED = Ray.GLOSSY, Ray.TRANSMISSION


class TriangleAppearance(NamedTuple):
    """Fields of a RenderScene for n triangles; tile_index is -1 where no ray meets them."""

    tile_index: np.ndarray
    emission: np.ndarray
    camera_tile: np.ndarray
    hidden: np.ndarray
    back_tile: np.ndarray
    shadow_tile: np.ndarray
    shining_side: np.ndarray  # 1 the front alone, -1 the back alone, 0 both
    is_holdout: np.ndarray
    emission_tile: np.ndarray

    @classmethod
    def empty(cls, count: int) -> TriangleAppearance:
        index = np.zeros(count, np.int32)
        return cls(index, np.zeros((count, 3), np.float32), index.copy(), np.zeros(count, np.uint8), index.copy(),
                   index - 1, index.copy(), np.zeros(count, bool), index - 1)


def find_appearance(materials: MaterialTiles, material: Material | None, mesh: TriangleMesh,
                    instance: Instance) -> TriangleAppearance:
    """What rays meet of triangles with one material: light that has bounced sees them as diffuse rays do."""
    index, emission = materials.triangle_tiles(material, mesh, instance)
    appearance = TriangleAppearance.empty(len(mesh))._replace(
        tile_index=index, emission=emission, camera_tile=index, back_tile=index,
        is_holdout=materials.cuts_holes(material, mesh, instance))
    if emission.any():
        appearance = appearance._replace(emission_tile=materials.emission_index(material, mesh, instance, emission))
    if materials.differs_by_side(material):
        appearance = _with_backs(appearance, *materials.triangle_tiles(material, mesh, instance, is_behind=True))
    if materials.differs_by_ray(material):
        appearance = _by_ray(appearance, materials, material, mesh, instance)
    return appearance


def _by_ray(appearance: TriangleAppearance, materials: MaterialTiles, material: Material, mesh: TriangleMesh,
            instance: Instance) -> TriangleAppearance:
    """The appearance, also as other rays than diffuse ones meet it."""
    index = appearance.tile_index
    tiles = {Ray.DIFFUSE: index, Ray.CAMERA: materials.triangle_tiles(material, mesh, instance, Ray.CAMERA)[0]}
    for ray, clear in OTHER_RAYS.items():
        unrecorded = MaterialTiles(Report(), materials.baker)
        tiles[ray] = unrecorded.triangle_tiles(material, mesh, instance, ray, clear)[0]
    hidden = sum(np.where(tile < 0, np.uint8(ray), np.uint8(0)) for ray, tile in tiles.items())
    for ray in MIRRORED:
        if ((index < 0) & (tiles[ray] >= 0)).any():
            index = np.where(index < 0, materials.triangle_tiles(material, mesh, instance, ray)[0], index)
    is_met = np.any([tile >= 0 for tile in tiles.values()], axis=0)
    window = materials.constant_index(WINDOW, extras=CLEAR_EXTRAS)
    index = np.where((index < 0) & is_met, window, index).astype(np.int32)
    camera_tile = np.where(tiles[Ray.CAMERA] < 0, index, tiles[Ray.CAMERA]).astype(np.int32)
    back_tile = np.where(appearance.tile_index < 0, index, appearance.back_tile)
    appearance = appearance._replace(tile_index=index, camera_tile=camera_tile, hidden=hidden, back_tile=back_tile)
    if (tiles[Ray.SHADOW] < 0).any():
        clear_tile = materials.triangle_tiles(material, mesh, instance, Ray.SHADOW, clear=np.inf)[0]
        appearance = appearance._replace(shadow_tile=np.where(tiles[Ray.SHADOW] < 0, clear_tile, -1).astype(np.int32))
    return appearance


def _with_backs(appearance: TriangleAppearance, back_tile: np.ndarray, behind: np.ndarray) -> TriangleAppearance:
    """The appearance with the tiles and the emission of the backs. A side that alone is clear looks like the other."""
    front = np.where(appearance.tile_index < 0, back_tile, appearance.tile_index)
    back = np.where(back_tile < 0, appearance.tile_index, back_tile)
    shines, shines_behind = appearance.emission.any(axis=1), behind.any(axis=1)
    both = (shines & shines_behind)[:, None]
    emission = np.where(both, (appearance.emission + behind) / 2, appearance.emission + behind)
    side = shines.astype(np.int32) - shines_behind
    return appearance._replace(tile_index=front, camera_tile=front, back_tile=back, emission=emission,
                               shining_side=side)
