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
GLOW_TOGETHER = 0.1   # share of the irradiance in the middle of the scene that these surfaces may bring together

# of the training scenes
LIGHTS = 8                     # single triangles
LIGHT_AREA = 0.0087, 0.0135    # of each, in network units
LIGHT_RADIANCE = 312, 5000     # of the strongest channel, in network exposure
FACTOR = 3                     # times outside of these ranges, from which a remark is made
TRIANGLES = 65536
WELL_KNOWN = 16384             # triangles of stages 5 and 6 of the training, the last with glass
THINNEST = 0.5 / CELLS         # side of a volume cell, network units


def find_emitters(scene: RenderScene) -> np.ndarray:
    """(N,) bool: the triangles that are lights for the network.

    The network shows no reflection of a light: right for lamps, wrong for a wall that emits a little. Visible triangles
    of up to `GLOW` are surfaces like any other, and the guides add their emission; but the dimmest first, and only
    while together they bring little light to the rest of the scene.
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
    """The scene of the network's tokens. emits: the result of `find_emitters`.

    The network draws every token but lights, so the black plates and shades that shape the light of lamps, and that no
    camera sees, are removed.
    """
    retained = scene.is_seen | emits
    shining = replace(scene, emission=scene.emission * emits[:, None])
    if retained.all():
        return shining
    return replace(shining, **{name: getattr(shining, name)[retained] for name, layout in layouts(scene).items()
                               if layout.shape[0] == "N" and getattr(shining, name) is not None})


def describe_untrained(scene: RenderScene) -> list[str]:
    """A sentence for everything in a scene, the result of `as_trained`, that training scenes did not have."""
    lights = scene.is_light
    corners, radiance = scene.triangles[lights], scene.emission[lights].max(axis=1)
    area = np.linalg.norm(area_vectors(corners), axis=1)
    inside = (np.abs(corners.mean(axis=1)) < HALF_EXTENT).all(axis=1)
    result = []
    if len(corners) > LIGHTS:
        result.append(f"{len(corners)} triangles are lights, training scenes had 1 to {LIGHTS}")
    if not len(corners):
        result.append("no triangle is a light, every training scene had 1 or more")
    result += _range("as large", area, LIGHT_AREA) + _range("as bright", radiance, LIGHT_RADIANCE)
    if inside.any():
        result.append(f"{inside.sum()} of {len(corners)} light triangles are inside the scene, where training scenes "
                     "had none: theirs were 2.1 to 2.7 times its longest side away")
    if len(scene) > TRIANGLES:
        result.append(f"{len(scene)} triangles, training scenes had up to {TRIANGLES}: lower Max Triangles")
    if scene.volumes:
        side = scene.volumes.scale.min(axis=1) / CELLS
        if (thin := int((side < 0.99 * THINNEST).sum())):
            result.append(f"{thin} of {len(side)} volume cells are thinner than those of training scenes, by up to "
                         f"{THINNEST / side.min():.1f} times")
    return result


def _range(how: str, values: np.ndarray, trained: tuple[float, float]) -> list[str]:
    """Sentences about values far outside of the trained range."""
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
