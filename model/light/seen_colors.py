# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of lobes as a camera sees them, where Cycles' passes do not say so: more gloss, and less of what is below it,
towards grazing angles, and sheen at silhouettes."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ..camera import view_rays
from ..first_hits import glass_from_inside
from ..first_hits.hit_materials import hit_roughness_below, hit_texels, hit_values
from ..geometry import dot
from ..material import sheen
from ..material.reflectance import LEAST_LAYER, layer_reflectance, normal_reflectance
from ..scene import BASE_COLOR, IOR, METALLIC, PARAMETERS, TRANSMISSION, Guides, RenderScene, View
from .fresnel import split_sum


def with_seen_colors(guides: Guides, scene: RenderScene, view: View) -> Guides:
    """First hits by rays (world frame), whose colours are those at normal incidence, with those of the view."""
    cosine = -dot(guides.normal, view_rays(view)[1]).clip(-1, 0)
    texel = hit_texels(scene, guides, PARAMETERS)
    base, metallic, transmission = texel[..., BASE_COLOR], texel[..., METALLIC, None], texel[..., TRANSMISSION]
    straight, slanting = _split_sum(cosine, hit_roughness_below(scene, guides))
    metal = (base * straight + slanting) / (straight + slanting)  # with the light between its facets
    f0, before = layer_reflectance(texel[..., IOR], transmission), normal_reflectance(texel[..., IOR])
    above = np.zeros_like(cosine)[..., None]
    if scene.coat is not None:
        weight, coat_f0, roughness, _ = np.moveaxis(hit_values(scene, guides, scene.coat), -1, 0)
        of_coat, slanting_coat = _split_sum(cosine, roughness)
        above = weight[..., None] * (coat_f0[..., None] * of_coat + slanting_coat)
        f0 = 1 - (1 - f0) / (1 - weight * coat_f0)  # of the layer below, which the tile's contains both
    f0 = f0[..., None].clip(0)
    layer = f0 * straight + (f0 / LEAST_LAYER).clip(max=1) * slanting
    glossy = above + (1 - above) * (metallic * metal + (1 - metallic) * layer)
    glossy -= metallic * base + (1 - metallic) * before[..., None]
    below, alpha = (1 - above) * (1 - layer), guides.alpha[..., None]
    colors = {"glossy_color": guides.glossy_color + alpha * glossy,
              "diffuse_color": below * (guides.diffuse_color + alpha * _change_of_sheen(guides, scene, cosine)),
              "transmission_color": below * guides.transmission_color}
    seen = replace(guides, **{name: color.clip(0).astype(np.float32) for name, color in colors.items()})
    return glass_from_inside.with_reflectance(seen, scene, view)


def _split_sum(cosine: np.ndarray, roughness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 1) each, as fresnel.split_sum."""
    terms = split_sum(*(torch.from_numpy(np.ascontiguousarray(x, np.float32)) for x in (cosine, roughness)))
    return tuple(term.numpy()[..., None] for term in terms)


def _change_of_sheen(guides: Guides, scene: RenderScene, cosine: np.ndarray) -> np.ndarray | float:
    """(H, W, 3) what a sheen adds to its mean over all views."""
    if scene.sheen is None:
        return 0.0
    color, roughness = np.split(hit_values(scene, guides, scene.sheen), [3], axis=-1)
    steps = np.linspace(0, 1, 33)
    mean = np.interp(roughness, steps, sheen.mean_albedo(steps[:, None])[:, 0])
    return color * (sheen.albedo(cosine[..., None], roughness) - mean)
