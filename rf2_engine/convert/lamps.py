# SPDX-License-Identifier: GPL-3.0-or-later
"""All lamps and suns of a scene as triangles, within their share of the budget."""
from __future__ import annotations

import numpy as np

from ...model.geometry import area_vectors
from ...model.scene import RenderScene
from .collected import LampInstance
from .light import COARSE, FINE, convert_light, convert_sun
from .suns import Sun


def convert_lamps(lamps: list[LampInstance], suns: list[Sun], budget: int, center: np.ndarray, radius: float,
                  report) -> list[RenderScene]:
    """Triangles of each lamp and each sun; too many lamps become coarser, and at last the weakest are left out.

    budget: most triangles of all together; center (3,) and radius: bounding sphere of the scene, world units.
    """
    for detail in FINE, COARSE:
        shapes = [convert_light(lamp.matrix, lamp.light, lamp.name, report, center, radius, detail) for lamp in lamps]
        shapes += [convert_sun(sun, center, radius, detail) for sun in suns]
        if sum(map(len, shapes)) <= budget:
            break
        report.approximated("Lamps", "their shapes are coarser than usual: raise the Triangle Budget")
    flux = [np.linalg.norm(area_vectors(scene.triangles), axis=-1) @ scene.emission.mean(axis=1) for scene in shapes]
    kept = []
    for i in np.argsort(flux)[::-1]:
        if len(shapes[i]) <= budget:
            kept.append(i)
            budget -= len(shapes[i])
    if len(kept) < len(shapes):
        report.skipped("Lamps", f"no room for {len(shapes) - len(kept)} of {len(shapes)}: raise the Triangle Budget")
    return [shapes[i] for i in sorted(kept)]
