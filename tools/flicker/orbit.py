# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera of a scene, turning about what it looks at."""
from __future__ import annotations

from collections.abc import Iterator
from math import radians

import bpy

from mathutils import Matrix, Vector

from renderformer_v2.model.scene import View


def views(scene: bpy.types.Scene, frames: int, degrees: float) -> Iterator[View]:
    """Set the scene to one frame after the other, from its first one, and give its View.

    The camera turns by so many degrees a frame about a vertical axis, with the pose that the file is saved in in the
    middle; with 0 degrees it is animated as in the file. Raises SceneError when there is no usable camera.
    """
    from renderformer_v2.rf2_engine.convert.camera.camera import convert_camera

    if degrees and scene.camera:
        _animate(scene, [radians(degrees) * (index - (frames - 1) / 2) for index in range(frames)])
    for index in range(frames):
        scene.frame_set(scene.frame_start + index)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        scale = scene.render.resolution_percentage / 100
        yield convert_camera(depsgraph, int(scene.render.resolution_x * scale), int(scene.render.resolution_y * scale),
                             None)


def _animate(scene: bpy.types.Scene, angles: list[float]) -> None:
    """Key a copy of the camera at these angles: the camera itself may be animated or constrained."""
    pose = scene.camera.matrix_world.copy()
    camera = bpy.data.objects.new("Orbit", scene.camera.data)
    scene.collection.objects.link(camera)
    scene.timeline_markers.clear()  # they may bind other cameras
    scene.camera, camera.rotation_mode = camera, "QUATERNION"
    pivot = Matrix.Translation(_looked_at(scene, pose))
    for frame, angle in enumerate(angles, scene.frame_start):
        camera.matrix_world = pivot @ Matrix.Rotation(angle, 4, "Z") @ pivot.inverted() @ pose
        for path in ("location", "rotation_quaternion", "scale"):
            camera.keyframe_insert(path, frame=frame)


def _looked_at(scene: bpy.types.Scene, pose: Matrix) -> Vector:
    """The point on the camera's axis that is nearest to the middle of what is rendered, always in front of it."""
    corners = [item.matrix_world @ Vector(corner) for item in scene.objects
               if item.type == "MESH" and not item.hide_render for corner in item.bound_box]
    middle = sum(corners, Vector()) / max(len(corners), 1)
    forward = -pose.col[2].to_3d().normalized()
    size = max(((corner - middle).length for corner in corners), default=1.0)
    return pose.translation + forward * max((middle - pose.translation).dot(forward), 0.1 * size)
