# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera of a scene, turning about what it looks at."""
from __future__ import annotations

from collections.abc import Iterator
from math import radians

import bpy

from mathutils import Matrix, Vector

from renderformer_v2.model.scene import View


def views(scene: bpy.types.Scene, frames: int, degrees: float) -> Iterator[View]:
    """Set the scene to one frame after the other, and give its View.

    The camera turns by so many degrees a frame about a vertical axis, with the file's own pose in the middle; with 0
    degrees the file's animation is played from its first frame. Raises SceneError when there is no usable camera.
    """
    from renderformer_v2.rf2_engine.convert.camera.camera import convert_camera

    turn = _turning_camera(scene) if degrees and scene.camera else None
    for index in range(frames):
        if turn:
            turn(radians(degrees) * (index - (frames - 1) / 2))
        else:
            scene.frame_set(scene.frame_start + index)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        scale = scene.render.resolution_percentage / 100
        yield convert_camera(depsgraph, int(scene.render.resolution_x * scale), int(scene.render.resolution_y * scale),
                             None)


def _turning_camera(scene: bpy.types.Scene):
    """A function that poses a copy of the camera by an angle: the camera itself may be animated or constrained."""
    pose = scene.camera.matrix_world.copy()
    camera = bpy.data.objects.new("Orbit", scene.camera.data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    pivot = Matrix.Translation(_looked_at(scene, pose))

    def turn(angle: float) -> None:
        camera.matrix_world = pivot @ Matrix.Rotation(angle, 4, "Z") @ pivot.inverted() @ pose
        bpy.context.view_layer.update()
    return turn


def _looked_at(scene: bpy.types.Scene, pose: Matrix) -> Vector:
    """The point on the camera's axis that is nearest to the middle of what is rendered, always in front of it."""
    corners = [item.matrix_world @ Vector(corner) for item in scene.objects
               if item.type == "MESH" and not item.hide_render for corner in item.bound_box]
    middle = sum(corners, Vector()) / max(len(corners), 1)
    forward = -pose.col[2].to_3d().normalized()
    size = max(((corner - middle).length for corner in corners), default=1.0)
    return pose.translation + forward * max((middle - pose.translation).dot(forward), 0.1 * size)
