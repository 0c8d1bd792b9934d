# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass and water that the camera sees from their inside: from below a surface, or through a pane with turned normals.

Cycles' passes of colours then have the reflectance of the outside, 0.04 where all light is reflected, and so would our
light, which they multiply; the light of Cycles' own passes is as much brighter instead.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import view_rays_at
from ..geometry import LEAST_IOR, area_vectors, dot
from ..material.reflectance import fresnel
from ..scene import BASE_COLOR, IOR, TRANSMISSION, Guides, RenderScene, View, texels, tint_of_glass

CLEAR = 0.5   # transmission from which on a surface is glass
MATTE = 0.02  # diffuse color from which on a pixel shows something else too


def with_reflectance(guides: Guides, scene: RenderScene, view: View) -> Guides:
    """First hits (world frame) with the colours that such surfaces have by Fresnel's equations."""
    pixel = np.flatnonzero((guides.hit_triangle >= 0) & (guides.diffuse_color < MATTE).all(axis=-1))
    row, column = np.divmod(pixel, view.width)
    token, rays = guides.hit_triangle.ravel()[pixel], view_rays_at(view, column + 0.5, row + 0.5)[1]
    is_inside = dot(area_vectors(scene.triangles[token]), rays) > 0
    tile, of_token = np.unique(scene.tile_index[token[is_inside]], return_inverse=True)
    is_inside[is_inside] = (scene.tiles[tile, TRANSMISSION].mean(axis=(1, 2)) > CLEAR)[of_token]
    if not is_inside.any():
        return guides
    pixel, token, rays = pixel[is_inside], token[is_inside], rays[is_inside]
    normal, weights, coverage = (x.reshape(len(guides.alpha.ravel()), -1)[pixel] for x in (
        guides.normal, guides.hit_barycentric, guides.alpha))
    x, y = texels(weights)
    texel = scene.tiles[scene.tile_index[token], :, y, x].astype(np.float32)
    share, clear = fresnel(-dot(rays, normal), 1 / texel[:, IOR].clip(LEAST_IOR))[:, None], texel[:, TRANSMISSION, None]
    glossy, transmission = guides.glossy_color.copy(), guides.transmission_color.copy()
    of_pixels = glossy.reshape(-1, 3)
    of_pixels[pixel] = clear * share * coverage + (1 - clear) * of_pixels[pixel]
    transmission.reshape(-1, 3)[pixel] = clear * (1 - share) * coverage * tint_of_glass(texel[:, BASE_COLOR])
    return replace(guides, glossy_color=glossy, transmission_color=transmission)
