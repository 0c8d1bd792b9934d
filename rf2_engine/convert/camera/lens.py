# SPDX-License-Identifier: GPL-3.0-or-later
"""Points on the camera's lens to render from: aperture and focus, as in Cycles."""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mathutils import Matrix

from ....model.camera import shift_in_lens
from ....model.scene import View
from .eyes import Eye

GOLDEN, PLASTIC = 0.6180339887, 0.7548776662  # parts of a turn, or of a whole, whose multiples are spread evenly
NEAREST = 1e-3   # world units, least focus distance
POSE = ("location", "rotation_euler", "rotation_quaternion", "scale")  # follow the matrix when that is set


@dataclass(frozen=True)
class Lens:
    """The evaluated camera of one moment."""

    camera: object            # bpy.types.Object
    axes: np.ndarray          # (4, 3) right, up, backward (unit, perhaps sheared or mirrored) and position, world
    radius: float             # of the aperture, world units
    focus: float              # world units along the axis to the focal plane

    @classmethod
    def of(cls, eye: Eye) -> Lens:
        camera, matrix = eye.camera, eye.matrix
        data = camera.data
        axes = np.vstack([(matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)).T, matrix[:3, 3]])
        size = 1.0 if data.type == "ORTHO" else data.lens * 1e-3  # of Cycles' orthographic aperture at f/1
        radius = size / (2 * max(data.dof.aperture_fstop, 1e-5))
        return cls(camera, axes, radius, max(_focus_distance(data.dof, axes), NEAREST))

    def points(self, count: int) -> np.ndarray:
        """(count, 2) world units along the camera's x and y, evenly over the aperture, as are consecutive ones."""
        dof, index = self.camera.data.dof, np.arange(count)
        radius, turn = np.sqrt((index + 0.5) / count), index * GOLDEN % 1  # sunflower
        if dof.aperture_blades < 3:
            points = radius[:, None] * _circle(2 * np.pi * turn)
        else:
            half = np.pi / dof.aperture_blades  # angle that half an edge spans
            edge, along = np.divmod(turn * dof.aperture_blades, 1)
            middle = dof.aperture_rotation + 2 * half * edge
            points = radius[:, None] * (math.cos(half) * _circle(middle)
                                        + (math.sin(half) * (2 * along - 1))[:, None] * _circle(middle + np.pi / 2))
        points[:, 0] /= dof.aperture_ratio
        return self.radius * points[np.argsort(index * PLASTIC % 1)]

    def view(self, pinhole: View, point: np.ndarray) -> View:
        """The view from a point (2,) of the lens, whose center is that of `pinhole`."""
        offset, focus = point @ self.axes[:2], self.focus
        if self.camera.data.type == "ORTHO":  # its stand-in is farther away, and moves farther for rays to lean as much
            focus += (pinhole.camera_to_world[:3, 3] - self.axes[3]) @ pinhole.camera_to_world[:3, 2]
            offset = offset * focus / self.focus
        return shift_in_lens(pinhole, offset, focus)

    def look_from(self, point: np.ndarray, override) -> None:
        """Move Cycles' camera to a point (2,) of the lens; `override` is an Overrides (cycles/overrides.py).

        All eyes that belong to one camera move with it.
        """
        data, matrix = self.camera.data, np.array(self.camera.matrix_world, np.float64)
        matrix[:3, 3] += point @ self.axes[:2]
        if data.type == "ORTHO":
            matrix[:3, 2] = self.focus * self.axes[2] + point @ self.axes[:2]
        else:
            sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
            shift = point * data.lens / (self.focus * sensor)
            override(data, {"shift_x": data.shift_x - shift[0], "shift_y": data.shift_y - shift[1]})
        pose = {name: getattr(self.camera, name) for name in POSE}
        override(self.camera, pose | {"matrix_world": Matrix(matrix.tolist())})


def _focus_distance(dof, axes: np.ndarray) -> float:
    if dof.focus_object is None:
        return dof.focus_distance
    matrix, bone = dof.focus_object.matrix_world, dof.focus_subtarget
    if dof.focus_object.type == "ARMATURE" and bone in dof.focus_object.pose.bones:
        matrix = matrix @ dof.focus_object.pose.bones[bone].matrix
    return abs(float(axes[2] @ (axes[3] - np.array(matrix.translation))))


def _circle(angle: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
