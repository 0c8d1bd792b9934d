# SPDX-License-Identifier: GPL-3.0-or-later
"""A volume that fills the world becomes a box around what the camera sees, without light from beyond."""
from __future__ import annotations

import numpy as np

from ..data.collected import CollectedScene
from ..data.copied import Instance
from ..data.medium import Box
from ..shading.volume import has_volume, volume_coefficients, volume_points
from .volumes import shaded_medium

MARGIN = 0.01   # of the box's longest side, around it
NOWHERE = np.zeros((2, 3), np.float32)


def add_fog(collected: CollectedScene, world, box: np.ndarray, eye: np.ndarray | None, report) -> np.ndarray:
    """Adds the fog between an eye (3,) and a box (2, 3), and in it; returns (3,) the share of light from infinitely far
    that comes through all the rest, of each colour: 1 or 0."""
    if not has_volume(world):
        return np.ones(3)
    corners = np.concatenate([box, box if eye is None else [eye]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = MARGIN * max(float((high - low).max()), 1e-6)
    box = Box(np.eye(3), ((low + high) / 2).astype(np.float64), (high - low + 2 * margin).astype(np.float64))

    def coefficients(points):
        return volume_coefficients(world, report, volume_points(points, NOWHERE, Instance()))

    medium = shaded_medium(world.name, box, coefficients, report)
    extinction = medium.scattering + medium.absorption
    if not extinction.any():
        return np.ones(3)
    collected.media.append(medium)
    report.approximated(world.name, "its volume fills a box of " + " x ".join(f"{side:.3g}" for side in box.size)
                        + " m around what the camera sees. As in Cycles, light of the world and of suns does not pass "
                          "through it")
    return (extinction == 0).astype(np.float64)
