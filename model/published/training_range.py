# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a scene is unlike the published network's training data (docs/scene-input.md 1.2, 2.4, 5.4, 6.3)."""
from __future__ import annotations

import numpy as np

from ..geometry import area_vectors
from ..normalize import HALF_EXTENT
from ..scene import CELLS, RenderScene

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
