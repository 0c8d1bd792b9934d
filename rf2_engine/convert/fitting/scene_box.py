# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the box of the world that is scaled to the network's box: what the camera sees (docs/scene-input.md 1.2).

A ground to the horizon, a sky dome, a far mountain or objects far behind the camera must not shrink the subject. So the
box is that of the scene's surfaces, but no larger than what a picture at the usual distance shows. It does not depend
on how finely surfaces are divided.
"""
from __future__ import annotations

import numpy as np

from ....model.scene import View
from ..data.collected import Collected
from .visible import Hits

NEAR, FAR = 10, 30  # what is so many times as far as this percentile of the distances is background
REACH = 1.5         # half of the box, in halves of the picture's longer side at the usual distance


def find_box(collected: Collected, view: View, hits: Hits) -> np.ndarray:
    """(2, 3) f32 lowest and highest corner, world; those of all surfaces and media where the view shows none."""
    return fit_box(collected.bounds(), hits.points, view)


def fit_box(bounds: tuple[np.ndarray, np.ndarray], points: np.ndarray, view: View) -> np.ndarray:
    """The same for a view that shows `points` (k, 3) of what lies within `bounds`."""
    low, high = bounds
    if len(points):
        eye = view.camera_to_world[:3, 3]
        distance = np.linalg.norm(points - eye, axis=1)
        near = distance <= FAR * np.percentile(distance, NEAR)
        center = np.median(points[near], axis=0)
        half_picture = (view.longer_side / 2 / np.abs(view.focal)).max()
        reach = REACH * half_picture * np.median(distance[near])
        low, high = np.clip([low, high], center - reach, center + reach)
    return np.float32([low, high])
