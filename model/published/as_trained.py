# SPDX-License-Identifier: GPL-3.0-or-later
"""A normalised scene as the published network was trained on it, and what of it training scenes did not have
(docs/scene-input.md 1.2, 2.4, 3.5, 5.4, 6.3, 6.5).
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..fields import layouts
from ..geometry import area_vectors
from ..normalize import CENTRAL_IRRADIANCE, HALF_EXTENT, central_irradiance
from ..scene import CELLS, RenderScene

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


LIGHTS = 8                     # single triangles
LIGHT_AREA = 0.0087, 0.0135    # of each, in network units
LIGHT_RADIANCE = 312, 5000     # of the strongest channel, in network exposure
FACTOR = 3                     # beyond these so much is much
TRIANGLES = 65536
WELL_KNOWN = 16384             # triangles of stages 5 and 6 of the training, the last with glass
THINNEST = 0.5 / CELLS         # side of a volume cell, network units


def remarks(scene: RenderScene) -> list[str]:
    """A sentence each; scene: normalised, and as the network is told it (as_trained.py)."""
    lights = scene.is_light
    corners, radiance = scene.triangles[lights], scene.emission[lights].max(axis=1)
    area = np.linalg.norm(area_vectors(corners), axis=1)
    inside = (np.abs(corners.mean(axis=1)) < HALF_EXTENT).all(axis=1)
    found = []
    if len(corners) > LIGHTS:
        found.append(f"{len(corners)} triangles are lights, training scenes had 1 to {LIGHTS}")
    if not len(corners):
        found.append("no triangle is a light, every training scene had 1 or more")
    found += _range("as large", area, LIGHT_AREA) + _range("as bright", radiance, LIGHT_RADIANCE)
    if inside.any():
        found.append(f"{inside.sum()} of {len(corners)} light triangles are inside the scene, where training scenes "
                     "had none: theirs were 2.1 to 2.7 times its longest side away")
    if len(scene) > TRIANGLES:
        found.append(f"{len(scene)} triangles, training scenes had up to {TRIANGLES}: lower Max Triangles")
    if scene.volumes is not None and len(scene.volumes):
        side = scene.volumes.scale.min(axis=1) / CELLS
        if (thin := int((side < 0.99 * THINNEST).sum())):
            found.append(f"{thin} of {len(side)} volume cells are thinner than those of training scenes, by up to "
                         f"{THINNEST / side.min():.1f} times")
    return found


def _range(how: str, values: np.ndarray, trained: tuple[float, float]) -> list[str]:
    """Those that are far outside of what was trained."""
    low, high = trained
    less, more = int((values < low / FACTOR).sum()), int((values > high * FACTOR).sum())
    lines = []
    if less:
        lines.append(f"{less} of {len(values)} light triangles are less than {1 / FACTOR:.2f} times {how} as those of "
                     f"training scenes (the least {values.min() / low:.2g})")
    if more:
        lines.append(f"{more} of {len(values)} light triangles are more than {FACTOR} times {how} as those of training "
                     f"scenes (the most {values.max() / high:.2g})")
    return lines
