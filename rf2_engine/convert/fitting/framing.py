# SPDX-License-Identifier: GPL-3.0-or-later
"""The box and view that a scene is fitted to (docs/scene-input.md 1.2); later frames keep those of a key frame.

A ground to the horizon, a sky dome, a far mountain or objects far behind the camera must not shrink the subject. So the
box is that of the scene's surfaces, but no larger than what a picture shows at the usual distance. It does not
depend on how finely surfaces are divided.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....model.scene import View
from ..data.collected import CollectedScene
from ..meshes.reduce import COARSEST
from .apparent_size import ApparentSize
from .visible import VisiblePoints

NEAR, FAR = 10, 30  # percentile of the distances; what is FAR times as far away is background
REACH = 1.5         # half of the box, in halves of the picture's longer side at the usual distance
ROOM = 1.15   # factor on the triangles that a mesh loses, if any: room for others in the next frames
STEADY = 1.3  # a mesh keeps its triangles while its new share is within this factor
STEP = 1.3    # between the numbers of triangles that a mesh may have otherwise


def find_box(collected: CollectedScene, view: View, hits: VisiblePoints) -> np.ndarray:
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


@dataclass
class Framing:
    box: np.ndarray      # (2, 3) f32, lowest and highest corner of what becomes the network's box
    apparent: ApparentSize | None  # triangles are allotted by it; None: everything counts alike
    shares: dict[tuple, int] | None = None  # by mesh, its triangles in the key frame; None until that is known

    def stabilize(self, keys: list[tuple], shares: np.ndarray, counts: np.ndarray, copies: np.ndarray,
                  budget: int) -> np.ndarray:
        """(k,) int shares of meshes as in the key frame, where they are about right and fit.

        keys: of meshes; shares, counts, copies: (k,) triangles they should have and have, and instances.
        The first call is for the key frame.
        """
        if self.shares is None:
            self.shares = dict(zip(keys, shares.tolist(), strict=True))
            return shares
        before = np.array([self.shares.get(key, 0) for key in keys], np.int64)
        about_right = (before <= STEADY * shares) & (shares <= STEADY * before)
        stable = np.where(about_right, before, np.where(shares < counts, _round_down(shares, shares), shares))
        less = _round_down(shares / ROOM, shares)
        for i in np.argsort((shares - stable) * copies, kind="stable"):
            if stable @ copies <= budget or stable[i] <= shares[i]:
                break
            stable[i] = less[i]
        return stable


def _round_down(targets: np.ndarray, most: np.ndarray) -> np.ndarray:
    """(k,) largest powers of STEP up to the targets, but no less than COARSEST or, where that is less, `most`."""
    powers = STEP ** np.floor(np.log(np.maximum(targets, 1)) / np.log(STEP) + 1e-9)
    return np.maximum(powers.astype(np.int64), np.minimum(most, COARSEST))
