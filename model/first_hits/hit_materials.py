# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of the surfaces that pixels show, of the texels that first hits lie on."""
from __future__ import annotations

import numpy as np

from ..material.reflectance import LEAST_LAYER, layer_reflectance
from ..scene import (
    BASE_COLOR,
    IOR,
    METALLIC,
    PARAMETERS,
    ROUGHNESS,
    TILE_CHANNELS,
    TRANSMISSION,
    Guides,
    RenderScene,
    texels,
)

UNKNOWN_ROUGHNESS = 0.5  # where no token triangle lies behind a pixel (hair, sub-pixel geometry)
UNKNOWN_F0 = 0.04        # likewise, of a layer


def hit_roughness(scene: RenderScene, guides: Guides) -> np.ndarray:
    """(H, W) f32 roughness of the texel that each pixel's first hit lies on."""
    roughness = _hit_texels(scene, guides, slice(ROUGHNESS, ROUGHNESS + 1))[..., 0]
    return np.where(guides.hit_triangle >= 0, roughness, np.float32(UNKNOWN_ROUGHNESS))


def hit_reflectances(scene: RenderScene, guides: Guides) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(H, W) f32 each, of the same texel: share and f0 of its metal, share and f0 of a dielectric layer.

    A layer that reflects next to nothing at normal incidence has a share of 0.
    """
    texel = _hit_texels(scene, guides, PARAMETERS)
    is_known, metallic, transmission = guides.hit_triangle >= 0, texel[..., METALLIC], texel[..., TRANSMISSION]
    f0 = np.where(is_known, layer_reflectance(texel[..., IOR], transmission), UNKNOWN_F0)
    metal = is_known * metallic
    return metal, texel[..., BASE_COLOR].mean(-1), (1 - metal) * (f0 / LEAST_LAYER).clip(max=1), f0


def hit_roughness_below(scene: RenderScene, guides: Guides) -> np.ndarray:
    """(H, W) f32 roughness of what is below a clear coat; of other surfaces as `hit_roughness`."""
    roughness = hit_roughness(scene, guides)
    if scene.coat is None:
        return roughness
    return roughness_below(roughness, hit_values(scene, guides, scene.coat))


def roughness_below(roughness: np.ndarray, coat: np.ndarray) -> np.ndarray:
    """(...) of what is below coats (..., 4), as of RenderScene, by the roughness (...) of both together."""
    _, _, of_coat, share = np.moveaxis(coat, -1, 0)
    return ((roughness - share * of_coat) / (1 - share).clip(1e-3)).clip(0, 1)


def least_hit_roughness(scene: RenderScene, guides: Guides) -> np.ndarray:
    """(H, W) f32 roughness of the smoother one of a coat and what is below it."""
    roughness = hit_roughness_below(scene, guides)
    if scene.coat is None:
        return roughness
    weight, _, of_coat, _ = np.moveaxis(hit_values(scene, guides, scene.coat), -1, 0)
    return np.where(weight > 0, np.minimum(roughness, of_coat), roughness)


def hit_values(scene: RenderScene, guides: Guides, values: np.ndarray) -> np.ndarray:
    """(H, W, ...) of `values` (T, ...) of the tiles that pixels show; 0 where nothing is hit."""
    hit = guides.hit_triangle
    if not len(scene):
        return np.zeros((*hit.shape, *values.shape[1:]), np.float32)
    return values[scene.seen_tile[hit.clip(0)]] * (hit >= 0).reshape(*hit.shape, *[1] * (values.ndim - 1))


def _hit_texels(scene: RenderScene, guides: Guides, channels: slice) -> np.ndarray:
    """(H, W, C) f32, these channels of the material tiles; arbitrary where nothing is hit."""
    if guides.material is not None:
        return guides.material[..., channels].astype(np.float32)
    hit = guides.hit_triangle
    if not len(scene.triangles):
        return np.zeros((*hit.shape, len(range(TILE_CHANNELS)[channels])), np.float32)
    x, y = texels(guides.hit_barycentric)
    return scene.tiles[scene.seen_tile[np.maximum(hit, 0)], channels, y, x].astype(np.float32)
