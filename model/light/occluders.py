# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the triangles of a scene that block light."""
from __future__ import annotations

import numpy as np

from ..scene import BASE_COLOR, IOR, METALLIC, TRANSMISSION, RenderScene

BLACK = 1e-3         # base colour up to which an unseen surface is the back of a lamp
TRANSPARENT = 0.5    # transmission from which light passes
STRAIGHT = 1.05      # index of refraction up to which it passes straight on


def passes_light(scene: RenderScene, straight: bool = False) -> np.ndarray:
    """(N,) bool: glass, or only what light passes `straight`, such as leaves cut out by their alpha."""
    transmission, ior, metallic = scene.tiles[:, (TRANSMISSION, IOR, METALLIC)].mean(axis=(2, 3), dtype=np.float32).T
    passing = transmission * (1 - metallic) > TRANSPARENT
    if straight:
        passing &= ior < STRAIGHT
    return passing[scene.tile_index]


def bends_light(scene: RenderScene) -> np.ndarray:
    """(N,) bool: glass."""
    return passes_light(scene) & ~passes_light(scene, straight=True)


def is_solid(scene: RenderScene) -> np.ndarray:
    """(N,) bool: what is neither a lamp nor the back of one, which are there for the network alone."""
    black = scene.tiles[:, BASE_COLOR].max(axis=(1, 2, 3)) < BLACK
    return scene.is_seen | ~scene.is_light & ~black[scene.tile_index]
