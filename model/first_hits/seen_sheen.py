# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheen as a camera sees it: brightest at silhouettes, where a material's colour has its mean over all views."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import view_rays
from ..geometry import dot
from ..material.sheen import albedo, mean_albedo
from ..scene import SHEEN, Guides, RenderScene, View
from .hit_materials import hit_values


def with_sheen(guides: Guides, scene: RenderScene, view: View) -> Guides:
    """First hits by rays (world frame), their diffuse colour with the sheen that the view shows."""
    if scene.sheen is None:
        return guides
    color, roughness = np.split(hit_values(scene, guides, scene.sheen), [SHEEN["roughness"].start], axis=-1)
    seen = albedo(-dot(guides.normal, view_rays(view)[1]), roughness[..., 0])
    steps = np.linspace(0, 1, 33)
    mean = np.interp(roughness[..., 0], steps, mean_albedo(steps[:, None])[:, 0])
    change = guides.alpha[..., None] * color * (seen - mean)[..., None]
    return replace(guides, diffuse_color=(guides.diffuse_color + change).clip(0).astype(np.float32))
