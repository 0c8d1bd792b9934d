# SPDX-License-Identifier: GPL-3.0-or-later
"""The evaluated scene camera as a `View` (docs/scene-input.md 1.3, 1.4)."""
from __future__ import annotations

import numpy as np

from ....model.errors import SceneError
from ....model.scene import View
from . import orthographic


def convert_camera(depsgraph, width: int, height: int, border: tuple[int, int, int, int] | None,
                   report=None) -> View:
    """The View of the scene's camera for a picture of `width` x `height` pixels (resolution percentage applied).

    `border` is (x0, x1, y0, y1) in pixels from the bottom left of that picture, or None for all of it. Lens shift,
    sensor fit and pixel aspect are taken from the projection matrix that Blender itself uses. An orthographic camera
    becomes a distant perspective one, and `report` (rf2_engine/convert/report.py) says so.

    Raises SceneError when there is no camera or its projection cannot be expressed.
    """
    scene = depsgraph.scene_eval
    if scene.camera is None:
        raise SceneError(f'Scene "{scene.name}" has no camera: add one and make it active')
    camera = scene.camera.evaluated_get(depsgraph)
    if camera.type != "CAMERA":
        raise SceneError(f'"{camera.name}" is used as the camera but is a {camera.type.lower()}: choose a camera')
    if camera.data.type not in {"PERSP", "ORTHO"}:
        kind = "panoramic" if camera.data.type == "PANO" else camera.data.type.lower()
        raise SceneError(f'Camera "{camera.name}" is {kind}, which is not supported: set its Type to Perspective with '
                         "a wide lens, or to Orthographic, in Camera Properties > Lens")
    projection = np.array(camera.calc_matrix_camera(
        depsgraph, x=width, y=height, scale_x=scene.render.pixel_aspect_x, scale_y=scene.render.pixel_aspect_y))
    if not (np.isfinite(projection).all() and projection[0, 0] and projection[1, 1]):
        raise SceneError(f'Camera "{camera.name}" sees nothing: set its Clip End beyond its Clip Start')
    camera_to_world, mirror = rigid(np.array(camera.matrix_world, np.float64), camera.name, report)
    if camera.data.type == "ORTHO":
        projection = orthographic.as_perspective(projection, camera_to_world, depsgraph)
        if report is not None:
            report.approximated(camera.name, "orthographic camera is rendered as a distant perspective camera")
    scale = np.array([projection[0, 0], projection[1, 1]])
    shift = np.array([-projection[0, 2], projection[1, 2]])
    half = np.array([width, height]) / 2
    focal, principal, size = scale * half * (mirror, 1), (1 + shift) * half, max(width, height)
    corner = 0, 0
    if border is not None:
        x0, x1, y0, y1 = border
        corner = x0, height - y1
        principal -= corner
        width, height = x1 - x0, y1 - y0
    return View(camera_to_world.astype(np.float32), focal.astype(np.float32), principal.astype(np.float32),
                width, height, size, corner)


def clip_start(depsgraph) -> float:
    """World units along the axis of the camera's View before which it sees nothing; 0 of an orthographic camera."""
    data = depsgraph.scene_eval.camera.data
    return data.clip_start if data.type == "PERSP" else 0.0


def rigid(matrix: np.ndarray, name: str, report) -> tuple[np.ndarray, float]:
    """`matrix` without scale and shear, and -1 if it mirrors the picture.

    A mirrored camera becomes a rigid one whose x axis is turned round; a negative focal length turns the picture back.
    """
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:3, :3])) < 1e-30:
        raise SceneError(f'Camera "{name}" has a scale of zero or a transform that is not finite: reset its scale')
    right, up, backward = (matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)).T
    if report is not None and max(abs(right @ up), abs(up @ backward), abs(backward @ right)) > 1e-4:
        report.approximated(name, "the shear of the camera is ignored")
    mirror = np.sign(np.cross(right, up) @ backward)
    right = np.cross(up, backward)
    rigid = np.eye(4)
    rigid[:3, 0] = right / np.linalg.norm(right)
    rigid[:3, 1] = np.cross(backward, rigid[:3, 0])
    rigid[:3, 2], rigid[:3, 3] = backward, matrix[:3, 3]
    return rigid, mirror
