# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss whose facets do not light each other: files of Blender before 4.0 have it, and Glossy BSDFs with GGX.

Cycles' pass of its colour is that of smooth surfaces, and the light of Cycles' own passes is as much darker as facets
hide from each other. Estimates are of surfaces that lose nothing, so their albedo is what gets out.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import view_rays
from ..geometry import dot
from ..material.reflectance import split_sum
from ..scene import COAT, Guides, RenderScene, View
from .hit_materials import hit_roughness_below, hit_values


def with_kept(guides: Guides, scene: RenderScene, view: View) -> Guides:
    """First hits (world frame) that know what of such gloss gets out; clear coats lose nothing."""
    if scene.single is None:
        return guides
    single = hit_values(scene, guides, scene.single)
    if scene.coat is not None:
        single = single * (1 - hit_values(scene, guides, scene.coat)[..., COAT["share"]][..., 0])
    at = single > 0
    white = split_sum(-dot(guides.normal[at], view_rays(view)[1][at]), hit_roughness_below(scene, guides)[at])[0]
    kept = np.ones_like(guides.alpha)
    kept[at] = 1 - single[at] * (1 - white)
    return replace(guides, glossy_kept=kept)
