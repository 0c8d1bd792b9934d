# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras of a picture: the scene's, or in stereoscopy an eye for every one of Blender's views."""
from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ....model.errors import SceneError


@dataclass(frozen=True)
class Eye:
    camera: bpy.types.Object  # evaluated
    matrix: np.ndarray        # (4, 4) f64 camera to world, perhaps scaled or mirrored
    shift_x: float            # of the lens, as the camera's own setting
    view: str = ""            # its name in the result; "" without stereoscopy


def own_eye(depsgraph: bpy.types.Depsgraph) -> Eye:
    """The scene's camera as it is. Raises SceneError when there is none."""
    scene = depsgraph.scene_eval
    if scene.camera is None:
        raise SceneError(f'Scene "{scene.name}" has no camera: add one and make it active')
    camera = scene.camera.evaluated_get(depsgraph)
    return Eye(camera, np.array(camera.matrix_world, np.float64), getattr(camera.data, "shift_x", 0.0))


def eyes(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> list[Eye]:
    """The eyes of all views that `engine` is to render, at the moment that is evaluated. Raises SceneError."""
    views = view_names(engine)
    if views == [""]:
        return [own_eye(depsgraph)]
    result = []
    for view in views:
        engine.active_view_set(view)
        camera = engine.camera_override
        if camera is None:
            raise SceneError(f'View "{view}" of scene "{depsgraph.scene_eval.name}" has no camera: add one whose name '
                             "ends in its suffix")
        if engine.use_spherical_stereo(camera):
            raise SceneError(no_spherical_stereo(camera))
        result.append(Eye(camera, np.array(engine.camera_model_matrix(camera), np.float64),
                          engine.camera_shift_x(camera), view))
    return result


def has_spherical_stereo(camera: bpy.types.Object | None) -> bool:
    """As far as it is one of Stereo 3D."""
    is_camera = camera is not None and camera.type == "CAMERA"
    return is_camera and camera.data.type != "ORTHO" and camera.data.stereo.use_spherical_stereo


def no_spherical_stereo(camera: bpy.types.Object) -> str:
    """Why a camera is refused whose eyes turn with the direction."""
    return (f'Camera "{camera.name}" uses Spherical Stereo, which is not supported: switch it off in Camera Properties '
            "> Stereoscopy")


def view_names(engine: bpy.types.RenderEngine) -> list[str]:
    """The views of the result; [""] without stereoscopy."""
    return [view.name for view in engine.get_result().views]


def count_views(scene: bpy.types.Scene) -> int:
    """How many views Blender will ask for."""
    settings = scene.render
    if not settings.use_multiview:
        return 1
    views = settings.stereo_views if settings.views_format == "STEREO_3D" else settings.views
    return max(sum(view.use for view in views), 1)
