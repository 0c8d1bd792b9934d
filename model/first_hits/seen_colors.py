# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of lobes as rays see them: more gloss, and less of what is below it, towards grazing angles, and sheen at
silhouettes. Cycles' passes have them, tiles have those at normal incidence."""
from __future__ import annotations

import numpy as np

from ..material import sheen
from ..material.reflectance import LAYERS, LEAST_LAYER, layer_reflectance, metal_share, normal_reflectance, split_sum
from ..scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, RenderScene
from .hit_materials import roughness_below

STEPS = np.linspace(0, 1, 33)[:, None]  # of roughness


def seen_colors(colors: np.ndarray, texel: np.ndarray, cosine: np.ndarray, scene: RenderScene,
                tile: np.ndarray) -> np.ndarray:
    """(3, P, 3) diffuse, glossy and transmission colour, of those at normal incidence.

    texel: (P, C) of materials; cosine: (P,), between normals and the directions to the viewer; tile: (P,), which say
    what coat and sheen are.
    """
    base, metallic, transmission = texel[:, BASE_COLOR], texel[:, METALLIC, None], texel[:, TRANSMISSION]
    f0, roughness = layer_reflectance(texel[:, IOR], transmission), texel[:, ROUGHNESS]
    above = np.zeros((len(texel), 1), np.float32)
    if scene.coat is not None:
        weight, coat_f0, of_coat, _ = scene.coat[tile].T
        white, _, slanting = split_sum(cosine, of_coat)
        slanting = _of_layer(slanting, coat_f0)
        above = (weight * (coat_f0 * (white - slanting) + slanting))[:, None]
        roughness = roughness_below(roughness, scene.coat[tile])
        f0 = (1 - (1 - f0) / (1 - weight * coat_f0)).clip(0)  # of the layer below, which the tile's contains both
    white, of_metal, slanting = split_sum(cosine, roughness)
    layer = _layer_share(f0, white, slanting)[:, None]
    white, of_metal = white[:, None], of_metal[:, None]
    metal = (base + (1 - base) * of_metal / white) * metal_share(base, white, scene.of_tiles("single")[tile, None])
    glossy = above + (1 - above) * (metallic * metal + (1 - metallic) * layer)
    glossy -= metallic * base + (1 - metallic) * normal_reflectance(texel[:, IOR, None])
    diffuse = colors[0]
    if scene.sheen is not None:
        color, of_sheen = np.split(scene.sheen[tile], [3], axis=1)
        mean = np.interp(of_sheen, STEPS[:, 0], sheen.mean_albedo(STEPS)[:, 0])
        diffuse = (diffuse + color * (sheen.albedo(cosine[:, None], of_sheen) - mean)).clip(0)
    below = (1 - above) * (1 - layer)
    return np.stack([below * diffuse, (colors[1] + glossy).clip(0), below * colors[2]]).astype(np.float32)


def layer_share(f0: np.ndarray, cosine: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    """(P,) share of uniform light that dielectric layers of f0 (P,) reflect to viewers at cosines (P,); roughness:
    (P,), perceptual."""
    white, _, slanting = split_sum(cosine, roughness)
    return _layer_share(f0, white, slanting)


def _layer_share(f0: np.ndarray, white: np.ndarray, slanting: np.ndarray) -> np.ndarray:
    """The same by what `split_sum` gives."""
    slanting = _of_layer(slanting, f0)
    return f0 * (white - slanting) + (f0 / LEAST_LAYER).clip(max=1) * slanting


def _of_layer(tabled: np.ndarray, f0: np.ndarray) -> np.ndarray:
    """(P,) between values (P, len(LAYERS))."""
    at = np.interp(f0, LAYERS, range(len(LAYERS)))
    low, row = at.astype(int).clip(max=len(LAYERS) - 2), np.arange(len(at))
    return tabled[row, low] + (at - low) * (tabled[row, low + 1] - tabled[row, low])
