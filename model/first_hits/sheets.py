# SPDX-License-Identifier: GPL-3.0-or-later
"""Half-transparent surfaces, such as thin curtains: pixels show the first one, and through it what lies behind.

Cycles finds either by chance. So with a few samples colours are noisy there, and neighbouring pixels have their first
hits on different surfaces. Here the sheet is the first hit, and its transmission what passes it straight.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import view_rays
from ..material.reflectance import normal_reflectance
from ..rays import Hits, Rays
from ..scene import (
    IOR,
    PARAMETERS,
    TRANSMISSION,
    Guides,
    RenderScene,
    View,
    texels,
)
from ..scene_rays import scene_rays
from ..surface_kinds import SEEN, Ray, clear_tiles
from .camera_rays import CameraRays
from .denoise_media import COLORS, varies
from .first_surfaces import FirstSurfaces
from .from_rays import colors_of_texels, material_of_tokens
from .hit_materials import MOST, own_texels

EVEN = 0.03               # standard deviation of what a tile transmits, above which it is a cut-out shape
LAYERS = 4                # of sheets before something else: where there are more, the means of samples tell more
GAP = 1e-4                # of the distance of the first sheet, behind a sheet where a ray goes on
SEEN_SKY = 0.02           # share of a pixel's samples that must have seen the sky


def sheet_tiles(scene: RenderScene) -> np.ndarray:
    """(T, 3) share of each colour that passes tiles straight which are half-transparent all over; 0 of others."""
    clear = clear_tiles(scene)
    share = clear.mean(axis=1)
    rows = np.flatnonzero((share > 0) & (share < MOST))
    rows = rows[scene.tiles[rows, TRANSMISSION].astype(np.float32).std(axis=(1, 2)) < EVEN]
    sheets = np.zeros_like(clear)
    sheets[rows] = clear[rows]
    return sheets


def through_sheets(guides: Guides, scene: RenderScene, view: View) -> Guides:
    """Guides whose first hits are the first half-transparent surfaces, in world units as scene and view are.

    Emission and environment of the guides already show what is seen through them. In scenes with media, which dim
    what lies behind, nothing changes.
    """
    sheets = sheet_tiles(scene)
    # By token; the last one, -1, is no surface.
    clear = np.append(sheets[scene.seen_tile] * ~scene.is_light[:, None], np.zeros((1, 3), np.float32), axis=0)
    if not clear.any() or scene.volumes:
        return guides
    caster, (eye, rays) = scene_rays(scene).among(SEEN, Ray.CAMERA), view_rays(view)
    token, rays = np.append(scene.surfaces.token, -1), rays.reshape(-1, 3)
    hits = caster.closest(eye, rays)
    pixels = np.flatnonzero(clear[token[hits.triangle]].any(axis=1))
    sky, layers = _sky_behind(caster, eye, rays[pixels], hits.distance[pixels], clear, token)
    few = layers <= LAYERS
    pixels, sky = pixels[few], sky[few]
    if not len(pixels):
        return guides
    is_sheet, rays = np.zeros(guides.alpha.shape, bool), rays[pixels]
    is_sheet.flat[pixels] = True
    first = FirstSurfaces.of_hits(scene, Hits(*(x[pixels] for x in hits)), eye, rays)
    tint, (x, y) = clear[first.token], texels(first.weights)
    texel = own_texels(scene.tiles[scene.seen_tile[first.token], :, y, x].astype(np.float32), tint)
    colors = colors_of_texels(texel) * (1 - tint.max(1, keepdims=True))
    colors[0] *= 1 - normal_reflectance(texel[:, IOR, None])  # what the layer above it lets through
    colors[2] = tint
    colors = _mixed_at_borders(colors, pixels, is_sheet, clear, CameraRays(scene, view))
    values = dict(zip(("position", "normal", "hit_triangle", "hit_barycentric"), first, strict=True))
    values |= dict(zip(COLORS, colors, strict=True)) | _sky_in(guides, pixels, sky)
    result = replace(guides, straight=is_sheet, **{
        name: _replaced(getattr(guides, name), pixels, value) for name, value in values.items()})
    material = material_of_tokens(scene, result)
    material.reshape(-1, material.shape[-1])[pixels] = texel[:, PARAMETERS]
    return replace(result, material=material)


def _sky_in(guides: Guides, pixels: np.ndarray, sky: np.ndarray) -> dict[str, np.ndarray]:
    """Environment (P, 3) and alpha (P,) of pixels that show shares (P, 3) of the sky through sheets.

    Beside pixels that show none they stay as samples found them.
    """
    shown = np.zeros((guides.alpha.size, 1), np.float32)
    shown[pixels, 0] = sky.any(axis=1)
    is_even = ~varies(shown.reshape(*guides.alpha.shape, 1)).reshape(-1, 1)[pixels]
    environment, through = guides.environment.reshape(-1, 3)[pixels], 1 - guides.alpha.reshape(-1, 1)[pixels]
    share = sky.mean(axis=1, keepdims=True)
    changes = (share > 0) & is_even & (through > SEEN_SKY)
    return {"environment": np.where(changes, environment / through.clip(SEEN_SKY) * share, environment),
            "alpha": 1 - np.where(changes, share, through)[:, 0]}


def _replaced(picture: np.ndarray, pixels: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A copy of a picture (H, W, ...) with these values at pixels by number."""
    picture = picture.copy()
    picture.reshape(-1, *picture.shape[2:])[pixels] = values
    return picture


def _mixed_at_borders(colors: np.ndarray, pixels: np.ndarray, is_sheet: np.ndarray, clear: np.ndarray,
                      camera: CameraRays) -> np.ndarray:
    """Colours (3, P, 3) of sheets in the middle of pixels by number, mixed with those of what is beside them where the
    picture (H, W) of sheets ends."""
    borders = np.flatnonzero(varies(is_sheet[..., None].astype(np.float32)).ravel()[pixels])
    for rows, samples in camera.sample_batches(pixels[borders]):
        is_own, here = clear[samples.token].any(-1)[..., None], borders[rows]
        colors[:, here] = np.where(is_own, colors[:, here, None], samples.colors).mean(2)
    return colors


def _sky_behind(caster: Rays, eye: np.ndarray, rays: np.ndarray, distance: np.ndarray, clear: np.ndarray,
                token: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) share of the sky that is seen through the sheets on rays (P, 3) from a point, and how many (P,) these are,
    up to LAYERS + 1.

    distance: (P,) of the first sheet.
    """
    sky, share, layers = np.zeros_like(rays), np.ones_like(rays), np.zeros(len(rays), int)
    row, travelled = np.arange(len(rays)), np.zeros_like(distance)
    for _ in range(LAYERS + 1):
        hits = caster.closest(eye + travelled[row, None] * rays[row], rays[row])
        misses, passed = hits.triangle < 0, clear[token[hits.triangle]]
        sky[row[misses]] = share[row[misses]]
        goes_on = passed.any(axis=1)
        row, passed = row[goes_on], passed[goes_on]
        share[row] *= passed
        layers[row] += 1
        travelled[row] += hits.distance[goes_on] + GAP * distance[row]
    return sky, layers
