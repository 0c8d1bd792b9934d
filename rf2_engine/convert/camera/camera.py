# SPDX-License-Identifier: GPL-3.0-or-later
"""The evaluated scene camera as a `View` (docs/scene-input.md 1.3, 1.4)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....model.errors import SceneError
from ....model.scene import View
from ..data.report import Report
from . import orthographic
from .eyes import Eye, own_eye
from .panoramic import read_panorama


def convert_camera(depsgraph, width: int, height: int, border: tuple[int, int, int, int] | None,
                   report: Report | None = None, eye: Eye | None = None) -> View:
    """The View of the scene's camera for a picture of `width` x `height` pixels (resolution percentage applied).

    `border` is (x0, x1, y0, y1) in pixels from the bottom left of that picture, or None for all of it. `eye` is the
    camera as it is, if not given. Lens shift, sensor fit and pixel aspect are taken from the projection matrix that
    Blender itself uses. An orthographic camera becomes a distant perspective one, and `report`
    (rf2_engine/convert/data/report.py) says so.

    Raises SceneError when there is no camera or its projection cannot be expressed.
    """
    scene, eye = depsgraph.scene_eval, eye or own_eye(depsgraph)
    camera = eye.camera
    if camera.type != "CAMERA":
        raise SceneError(f'"{camera.name}" is used as the camera but is a {camera.type.lower()}: choose a camera')
    if camera.data.type not in {"PERSP", "ORTHO", "PANO"}:
        raise SceneError(f'Camera "{camera.name}" is {camera.data.type.lower()}, which is not supported: set its Type '
                         "to Perspective, Orthographic or Panoramic in Camera Properties > Lens")
    camera_to_world, mirror = rigid(eye.matrix, camera.name, report)
    if camera.data.type == "PANO":
        panorama = read_panorama(camera, eye.shift_x, width, height, scene.render)
        fine = panorama.pixels_per_radian
        return _cut(View(camera_to_world.astype(np.float32), np.float32([fine * mirror, fine]),
                         np.float32([width, height]) / 2, width, height, round(2 * fine), panorama=panorama,
                         clip_start=camera.data.clip_start), border)
    projection = _projection(eye, depsgraph, width, height)
    is_open = camera.data.clip_end > camera.data.clip_start
    if not (is_open and np.isfinite(projection).all() and projection[0, 0] and projection[1, 1]):
        raise SceneError(f'Camera "{camera.name}" sees nothing: set its Clip End beyond its Clip Start')
    clip_start = camera.data.clip_start
    if camera.data.type == "ORTHO":
        before = camera_to_world[:3, 3].copy()
        projection = orthographic.to_perspective(projection, camera_to_world, depsgraph)
        clip_start += float(np.linalg.norm(camera_to_world[:3, 3] - before))
        if report is not None:
            report.approximated(camera.name, "orthographic camera is rendered as a distant perspective camera")
    scale = np.array([projection[0, 0], projection[1, 1]])
    shift = np.array([-projection[0, 2], projection[1, 2]])
    half = np.array([width, height]) / 2
    focal, principal = scale * half * (mirror, 1), (1 + shift) * half
    return _cut(View(camera_to_world.astype(np.float32), focal.astype(np.float32), principal.astype(np.float32),
                     width, height, max(width, height), clip_start=clip_start), border)


def _cut(view: View, border: tuple[int, int, int, int] | None) -> View:
    """The part of a whole picture's View inside the border."""
    if border is None:
        return view
    x0, x1, y0, y1 = border
    corner = x0, view.height - y1
    return replace(view, principal=view.principal - np.float32(corner), width=x1 - x0, height=y1 - y0, corner=corner)


def _projection(eye: Eye, depsgraph, width: int, height: int) -> np.ndarray:
    """(4, 4), Blender's. The evaluated camera is left as it was."""
    camera, settings = eye.camera, depsgraph.scene_eval.render
    own = camera.data.shift_x
    try:
        if eye.shift_x != own:
            camera.data.shift_x = eye.shift_x
        return np.array(camera.calc_matrix_camera(depsgraph, x=width, y=height, scale_x=settings.pixel_aspect_x,
                                                  scale_y=settings.pixel_aspect_y))
    finally:
        if eye.shift_x != own:
            camera.data.shift_x = own


def rigid(matrix: np.ndarray, name: str, report: Report | None) -> tuple[np.ndarray, float]:
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
