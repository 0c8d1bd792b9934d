# SPDX-License-Identifier: GPL-3.0-or-later
"""An orthographic camera as a distant perspective one."""
from __future__ import annotations

import numpy as np

# A perspective camera this many frame widths away sees an object one frame deep with 1 % of perspective.
DISTANCE = 100.0
DEPTHS = 10.0  # distance at least, in depths of the visible scene: 5 % of perspective at either end
VISIBLE = {"MESH", "VOLUME", "CURVES", "POINTCLOUD"}
FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))  # of a Blender bound_box


def to_perspective(projection: np.ndarray, camera_to_world: np.ndarray, depsgraph) -> np.ndarray:
    """The matrix (4, 4) that replaces an orthographic `projection`; the framing at the middle depth is kept.

    Moves `camera_to_world` (4, 4) back in place, behind everything that is in the picture.
    """
    heights = _visible_depths(projection @ np.linalg.inv(camera_to_world), depsgraph)
    nearest, farthest = (projection[2, 3] - heights) / projection[2, 2]
    frame = 2 / min(abs(projection[0, 0]), abs(projection[1, 1]))
    distance = max(DISTANCE * frame, DEPTHS * (farthest - nearest))
    camera_to_world[:3, 3] += (distance - (nearest + farthest) / 2) * camera_to_world[:3, 2]
    perspective = projection * distance
    # An offset of the picture is added to it in the last column, but multiplied by depth, which is -z, in the third.
    perspective[0, 2], perspective[1, 2] = -projection[0, 3], -projection[1, 3]
    return perspective


def _visible_depths(to_clip: np.ndarray, depsgraph) -> np.ndarray:
    """(2,) normalised depths, -1 to 1 between the clip distances, that hold the boxes of all that is in the picture."""
    depths = [[]]
    for instance in depsgraph.object_instances:
        obj = instance.object
        if obj.type in VISIBLE and (instance.show_self or instance.show_particles) and obj.visible_camera:
            to_picture = to_clip @ np.array(instance.matrix_world)
            box = np.array(obj.bound_box) @ to_picture[:3, :3].T + to_picture[:3, 3]
            depths.append(_depths_inside(box) if np.isfinite(box).all() else [])
    depths = np.concatenate(depths)
    return np.array([depths.min(), depths.max()] if len(depths) else [-1.0, -1.0])


def _depths_inside(box: np.ndarray) -> np.ndarray:
    """Last coordinates of a box (8, 3), cut off where it leaves the cube from -1 to 1; empty if it lies outside."""
    if (np.abs(box) <= 1).all():
        return box[:, 2]
    if (box > 1).all(axis=0).any() or (box < -1).all(axis=0).any():
        return np.zeros(0)
    depths = []
    for face in FACES:
        polygon = box[list(face)]
        for axis, side in np.ndindex(3, 2):
            polygon = _cut(polygon, 1 - (2 * side - 1) * polygon[:, axis])
        depths.append(polygon[:, 2])
    return np.concatenate(depths)


def _cut(polygon: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The part of a convex polygon (k, 3) where `inside` (k,), which is linear, is not negative."""
    end, end_inside = np.roll(polygon, -1, axis=0), np.roll(inside, -1)
    crossing = (inside < 0) != (end_inside < 0)
    share = np.divide(inside, inside - end_inside, out=np.zeros_like(inside), where=crossing)[:, None]
    corners = np.stack([polygon, polygon + share * (end - polygon)], axis=1)
    return corners[np.stack([inside >= 0, crossing], axis=1)]
