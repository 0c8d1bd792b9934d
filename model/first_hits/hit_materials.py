# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of the surfaces that pixels show, of the texels that first hits lie on."""
from __future__ import annotations

import numpy as np

from ..material.reflectance import LEAST_LAYER, layer_reflectance, normal_reflectance
from ..pictures import LUMINANCE
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
from ..surface_kinds import clear_tiles
from . import bumps

MOST = 0.97              # share that passes straight, above which there is hardly a surface
UNKNOWN_ROUGHNESS = 0.5  # where no token triangle lies behind a pixel (hair, sub-pixel geometry)
UNKNOWN_F0 = 0.04        # likewise, of a layer


def hit_roughness(scene: RenderScene, guides: Guides) -> np.ndarray:
    """(H, W) f32 roughness of the texel that each pixel's first hit lies on."""
    texel, is_known = _hit_texels(scene, guides, slice(ROUGHNESS, ROUGHNESS + 1))
    return np.where(is_known, texel[..., 0], np.float32(UNKNOWN_ROUGHNESS))


def hit_reflectances(scene: RenderScene, guides: Guides) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(H, W) f32 each, of the same texel: share and f0 of its metal, share and f0 of a dielectric layer.

    A layer that reflects next to nothing at normal incidence has a share of 0.
    """
    texel, is_known = _hit_texels(scene, guides)
    metallic, transmission = texel[..., METALLIC], texel[..., TRANSMISSION]
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
    """(H, W) f32 roughness of the lobe of the smoother one of a coat and what is below it."""
    roughness = bumps.with_bumps(hit_roughness_below(scene, guides), guides.normal_variance)
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


def own_texels(texel: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """Material texels (P, C) of surfaces alone, of those (P, C) that contain a window for `clear` (P, 3) light.

    The inverse of how the conversion mixes a material with a window, whose base colour is its squared and which is
    perfectly smooth.
    """
    share, texel = clear.max(axis=1).clip(1e-3, MOST), texel.copy()
    solid = 1 - share
    base = texel[:, BASE_COLOR] - clear ** 2 / share[:, None]
    texel[:, BASE_COLOR] = (base / solid[:, None]).clip(0)
    texel[:, METALLIC] = (texel[:, METALLIC] / (1 - texel[:, TRANSMISSION]).clip(1e-3)).clip(0, 1)
    texel[:, IOR] = 1 + (texel[:, IOR] - 1).clip(0) / solid
    gloss = solid * (texel[:, METALLIC] + normal_reflectance(texel[:, IOR]) / 2)
    texel[:, ROUGHNESS] = (texel[:, ROUGHNESS] * (gloss + share) / gloss.clip(1e-4)).clip(0, 1)
    texel[:, TRANSMISSION] = 0
    return texel


def _hit_texels(scene: RenderScene, guides: Guides, channels: slice = PARAMETERS) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, C) f32, these channels of the material tiles, and whether they are of what pixels show (H, W).

    Without what lets light pass straight. A texel may lie in a hole beside the leaf that a pixel shows.
    """
    is_known, clear = guides.hit_triangle >= 0, clear_tiles(scene)
    if not clear.any():
        return _tile_texels(scene, guides, channels), is_known
    texel, clear = _tile_texels(scene, guides, PARAMETERS), hit_values(scene, guides, clear)
    rows = clear.any(axis=-1)
    if guides.straight is not None:  # of these they are already of the surface alone
        rows &= ~guides.straight
    color = clear[rows] / clear[rows].max(axis=1, keepdims=True)
    # Transmission is the share of the window in the luminance of both.
    share = texel[rows, TRANSMISSION] * (texel[rows, BASE_COLOR] @ LUMINANCE) / (color ** 2 @ LUMINANCE)
    share = share.clip(0, 1)
    texel[rows] = own_texels(texel[rows], color * share[:, None])
    is_known[rows] = share < MOST
    return texel[..., channels], is_known


def _tile_texels(scene: RenderScene, guides: Guides, channels: slice) -> np.ndarray:
    """(H, W, C) f32, as of the tiles; arbitrary where nothing is hit."""
    if guides.material is not None:
        return guides.material[..., channels].astype(np.float32)
    hit = guides.hit_triangle
    if not len(scene.triangles):
        return np.zeros((*hit.shape, len(range(TILE_CHANNELS)[channels])), np.float32)
    x, y = texels(guides.hit_barycentric)
    return scene.tiles[scene.seen_tile[np.maximum(hit, 0)], channels, y, x].astype(np.float32)
