# SPDX-License-Identifier: GPL-3.0-or-later
"""What the camera looks at: the box of the world that becomes the network's (docs/scene-input.md 1.2).

A ground to the horizon, a sky dome or a far mountain must not shrink what is looked at, and what the camera does not
see far behind it must not either. So the box is that of the scene's surfaces, but no larger than what a picture of the
usual distance shows. How finely surfaces are divided does not change it.
"""
from __future__ import annotations

import numpy as np

from mathutils.bvhtree import BVHTree

from ...model.camera import view_rays_at
from ...model.scene import View
from .collected import Collected

GRID = 24           # rays along either side of the picture
SEEN = 4            # rays at least that hit something else than light
NEAR, FAR = 10, 30  # what is so many times as far as this percentile of the distances is background
REACH = 1.5         # half of the box, in halves of the picture's longer side at the usual distance
TRIANGLES = 40_000  # of stand-ins, about as many as a BVH of a tenth of a second holds
LEAST = 12          # of a mesh
BOX = np.array([(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
                (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)])  # corners of a box's triangles


def find_focus(found: Collected, view: View, clip_start: float = 0.0) -> np.ndarray:
    """(2, 3) f32 lowest and highest corner, world; those of all surfaces and media where the view shows none.

    clip_start: world units along the view's axis before which the camera sees nothing.
    """
    low, high = found.bounds()
    points = _seen_points(found, view, clip_start, shining=False)  # a sky dome is no more than a background
    if len(points) < SEEN:
        points = _seen_points(found, view, clip_start, shining=True)
    if len(points):
        eye = view.camera_to_world[:3, 3]
        distance = np.linalg.norm(points - eye, axis=1)
        near = distance <= FAR * np.percentile(distance, NEAR)
        center = np.median(points[near], axis=0)
        half_picture = (view.longer_side / 2 / np.abs(view.focal)).max()
        reach = REACH * half_picture * np.median(distance[near])
        low, high = np.clip([low, high], center - reach, center + reach)
    return np.float32([low, high])


def _seen_points(found: Collected, view: View, clip_start: float, shining: bool) -> np.ndarray:
    """(P, 3) world points that the rays of a GRID x GRID raster hit, through what shines unless `shining`."""
    triangles = _stand_ins(found, view.camera_to_world[:3, 3], shining)
    if not len(triangles):
        return np.zeros((0, 3))
    tree = BVHTree.FromPolygons(triangles.reshape(-1, 3).tolist(),
                                np.arange(3 * len(triangles)).reshape(-1, 3).tolist(), all_triangles=True)
    x, y = np.meshgrid((np.arange(GRID) + 0.5) / GRID * view.width, (np.arange(GRID) + 0.5) / GRID * view.height)
    eye, rays = view_rays_at(view, x.ravel(), y.ravel())
    starts = eye + rays * clip_start / -(rays @ view.camera_to_world[:3, 2:3])
    hits = (tree.ray_cast(start, ray)[0] for start, ray in zip(starts.tolist(), rays.tolist(), strict=True))
    return np.array([hit for hit in hits if hit is not None]).reshape(-1, 3)


def _stand_ins(found: Collected, eye: np.ndarray, shining: bool) -> np.ndarray:
    """(n, 3, 3) world triangles that look alike from afar: of a fine mesh every k-th, enlarged to the whole's area.

    Stochastic simplification (Cook et al. 2007). Fog around the eye (3,) is looked through.
    """
    placed = [box.corners()[BOX] for box in found.media if not box.holds(eye)]
    shown = [part for part in found.parts if part.is_shown and (shining or not part.emits)]
    instances = sum(len(part.matrices) for part in shown)
    share = max(TRIANGLES // max(instances, 1), LEAST)
    for part in shown:
        corners = part.mesh.corners
        if len(corners) > share:
            some = corners[np.linspace(0, len(corners) - 1, share).astype(int)]
            middle = some.mean(axis=1, keepdims=True)
            corners = middle + (some - middle) * np.sqrt(len(corners) / share)
        placed += [corners @ matrix[:3, :3].T + matrix[:3, 3] for matrix in part.matrices]
    return np.concatenate(placed) if placed else np.zeros((0, 3, 3))
