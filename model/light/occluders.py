# SPDX-License-Identifier: GPL-3.0-or-later
"""Which triangles of a scene block light, let it pass, or bend it."""
from __future__ import annotations

import numpy as np

from ..scene import BASE_COLOR, IOR, METALLIC, TRANSMISSION, RenderScene

BLACK = 1e-3         # base colour up to which a surface that no camera sees is the back of a lamp
TRANSPARENT = 0.5    # transmission from which on light passes
STRAIGHT = 1.05      # ior up to which light passes without a bend


def passes_light(scene: RenderScene, straight: bool = False) -> np.ndarray:
    """(N,) bool: glass and cut-outs by alpha; with `straight` only what does not bend light, such as cut-outs."""
    transmission, ior, metallic = scene.tiles[:, (TRANSMISSION, IOR, METALLIC)].mean(axis=(2, 3), dtype=np.float32).T
    passes = transmission * (1 - metallic) > TRANSPARENT
    if straight:
        passes &= ior < STRAIGHT
    return passes[scene.tile_index]


def bends_light(scene: RenderScene) -> np.ndarray:
    """(N,) bool: glass."""
    return passes_light(scene) & ~passes_light(scene, straight=True)


def is_solid(scene: RenderScene) -> np.ndarray:
    """(N,) bool: surfaces of the scene, without lamps and their black backs, which are tokens only."""
    black = scene.tiles[:, BASE_COLOR].max(axis=(1, 2, 3)) < BLACK
    return scene.is_seen | ~scene.is_light & ~black[scene.tile_index]
