# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a normalised scene the published network is told, and as what (docs/scene-input.md 3.5, 6.3, 6.5)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..fields import layouts
from ..normalize import CENTRAL_IRRADIANCE, central_irradiance
from ..scene import RenderScene

GLOW = 0.5            # radiance in network exposure; a white surface in the middle of the scene reflects 1.3
GLOW_TOGETHER = 0.1   # of all the light in the middle of the scene, that what only glows may bring


def emitters(scene: RenderScene) -> np.ndarray:
    """(N,) bool: the triangles that are lights for the network.

    A light is white and black to the camera there, so its own reflection is lost: right for lamps, wrong for a wall
    that shines a little. Up to `GLOW` what is seen is a surface like any other, whose glow the guides add; but the
    dimmest first, and only while they matter little to the rest of the scene.
    """
    lights = np.flatnonzero(scene.is_light)
    radiance = scene.emission[lights].max(axis=1)
    glow = np.where(scene.is_seen[lights], radiance, np.inf)
    order = np.argsort(glow)
    together = central_irradiance(scene, np.zeros(3, np.float32), 1.0)[order].cumsum()
    too_bright = glow[order][together > GLOW_TOGETHER * CENTRAL_IRRADIANCE]
    emits = np.zeros(len(scene), bool)
    emits[lights[glow >= min(GLOW, too_bright.min(initial=np.inf))]] = True
    return emits


def as_trained(scene: RenderScene, emits: np.ndarray) -> RenderScene:
    """The scene's tokens. emits: as of `emitters`.

    The network draws every token but lights: the black plates and shades that hold the light of lamps together, which
    no camera sees, are left out.
    """
    kept = scene.is_seen | emits
    shining = replace(scene, emission=scene.emission * emits[:, None])
    if kept.all():
        return shining
    return replace(shining, **{name: getattr(shining, name)[kept] for name, layout in layouts(scene).items()
                               if layout.shape[0] == "N" and getattr(shining, name) is not None})
