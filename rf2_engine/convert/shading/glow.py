# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that shine faintly beside other light: they reflect more than they emit, so they are no emitters."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....model.scene import BASE_COLOR, RenderScene
from .material_tiles import EMITTER_RADIANCE

FAINT = 0.5      # share of the brightest light's radiance below which a surface only glows
REFLECTS = 0.02  # base colour from which on


def with_glow(scene: RenderScene) -> RenderScene:
    """The scene with what its faint surfaces emit as their glow."""
    radiance = scene.emission.max(axis=1, initial=0)
    brightest = max(radiance.max(initial=0), 0 if scene.environment is None else scene.environment.max())
    base = scene.tiles[:, BASE_COLOR].mean(axis=(1, 2, 3), dtype=np.float32)[scene.tile_index]
    glows = ((radiance > 0) & (radiance < min(EMITTER_RADIANCE, FAINT * brightest)) & (base > REFLECTS)
             & scene.is_seen & ~scene.beam_axis.any(axis=1))
    if not glows.any():
        return scene
    return replace(scene, emission=np.where(glows[:, None], 0, scene.emission),
                   glow=np.where(glows[:, None], scene.emission, 0))
