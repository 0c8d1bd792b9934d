# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras a little beside another one, turned around what that one looks at."""
from __future__ import annotations

import bpy
import numpy as np

from mathutils import Matrix, Vector

AZIMUTH, ELEVATION = np.radians((15.0, 8.0))  # most, to either side
NEARNESS = 0.85, 1.15                         # distance to what is looked at, relative to before
TRIES = 8                                     # each smaller than the one before
CLEAR = 0.5                                   # of the way to what is looked at must be free


def moved_pose(rng: np.random.Generator, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph,
               pose: Matrix) -> Matrix:
    """A camera-to-world near `pose` on the same side of all walls; where there is no room it is only turned.

    A camera that looks at nothing is turned in its place, too. Raises nothing.
    """
    eye, forward = pose.translation, -pose.col[2].to_3d().normalized()
    distance = free_way(scene, depsgraph, eye, forward)
    for size in np.linspace(1, 1 / TRIES, TRIES):
        azimuth, elevation = size * rng.uniform(-1, 1, 2) * (AZIMUTH, ELEVATION)
        turn = Matrix.Rotation(azimuth, 4, "Z") @ Matrix.Rotation(elevation, 4, pose.col[0].to_3d().normalized())
        if not np.isfinite(distance):
            break
        pivot = eye + distance * forward
        moved = Matrix.Translation(pivot) @ turn @ Matrix.Translation(-pivot) @ pose
        moved.translation = pivot + (moved.translation - pivot) * (1 + size * (rng.uniform(*NEARNESS) - 1))
        step = moved.translation - eye
        if (free_way(scene, depsgraph, eye, step) > 2 * step.length
                and free_way(scene, depsgraph, moved.translation, pivot - moved.translation) > CLEAR * distance):
            return moved
    return Matrix.Translation(eye) @ turn @ Matrix.Translation(-eye) @ pose


def free_way(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, start: Vector, direction: Vector) -> float:
    """How far it is to the first surface, in metres; infinity where there is none."""
    hit, place, *_ = scene.ray_cast(depsgraph, start, direction.normalized())
    return (place - start).length if hit else np.inf
