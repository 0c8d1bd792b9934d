# SPDX-License-Identifier: GPL-3.0-or-later
"""A volume that fills the world becomes a box around what the camera sees and its lamps, without light from beyond."""
from __future__ import annotations

import numpy as np

from ....model.camera import view_rays_at
from ....model.geometry import dot, unit
from ....model.scene import View
from ..data.collected import CollectedScene
from ..data.copied import Instance
from ..data.medium import Box
from ..data.report import Report
from ..shading.volume import has_volume, volume_coefficients, volume_points
from .volumes import shaded_medium

MARGIN = 0.01   # of the box's longest side, around it
NEARBY = 0.5    # longest sides of the rest from it, as far as lamps are in the box
INWARDS = 0.1   # halves of the picture from a corner to where the picture shows the same
NOWHERE = np.zeros((2, 3), np.float32)


def add_fog(collected: CollectedScene, world, box: np.ndarray, view: View | None, shown: np.ndarray | None,
            report: Report) -> np.ndarray:
    """Adds the fog in a box (2, 3), where a view looks past the surfaces that it shows, and around lamps nearby.

    shown: (P, 3) points of these; None without a view. Returns (3,) the share of light from infinitely far that comes
    through all the rest, of each colour: 1 or 0.
    """
    if not has_volume(world):
        return np.ones(3)
    points = box if view is None else np.concatenate([box, _points_past(view, box, shown)])
    low, high = points.min(axis=0), points.max(axis=0)
    reach = NEARBY * (high - low).max()
    lamps = np.array([lamp.matrix[:3, 3] for lamp in collected.lamps if lamp.light.type != "SUN"]).reshape(-1, 3)
    near = lamps[((lamps > low - reach) & (lamps < high + reach)).all(axis=1)]
    points = np.concatenate([points, near])
    low, high = points.min(axis=0), points.max(axis=0)
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


def _points_past(view: View, box: np.ndarray, surfaces: np.ndarray) -> np.ndarray:
    """(k, 3) the eye, and points at the corners of the picture where these show none of the surfaces (P, 3), as far
    off as the middle of the box."""
    across, down = (x.ravel() for x in np.meshgrid((0, view.width), (0, view.height)))
    eye, rays = view_rays_at(view, across, down)
    inwards = view_rays_at(view, across + INWARDS * (view.width / 2 - across),
                           down + INWARDS * (view.height / 2 - down))[1]
    nearest = (rays @ unit(surfaces - eye).T).max(axis=1, initial=-1)
    open_rays = rays[nearest < dot(rays, inwards)]
    return np.concatenate([[eye], eye + np.linalg.norm(box.mean(axis=0) - eye) * open_rays])
