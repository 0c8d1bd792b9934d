# SPDX-License-Identifier: GPL-3.0-or-later
"""Check a view layer before it is rendered: report what will be missing, and raise for what cannot be rendered."""
from __future__ import annotations

import bpy

from ...model.errors import SceneError
from ...model.published.bundle_files import check_weights
from ...model.weights.presets import weights_folder
from .. import compat, passes
from ..convert.camera.eyes import has_spherical_stereo, no_spherical_stereo
from ..convert.data.report import Report
from ..settings import FrameSettings, Light

LONGEST_NAME = 63  # bytes of view layer, pass and channel together, of every engine, in a multilayer file


def check(depsgraph: bpy.types.Depsgraph, settings: FrameSettings, report: Report) -> None:
    """Report what the whole picture lacks. Raises SceneError and CheckpointError for what cannot be rendered."""
    check_weights(weights_folder(settings.weights))
    scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    if scene.render.use_multiview and scene.render.views_format == "STEREO_3D" and has_spherical_stereo(scene.camera):
        raise SceneError(no_spherical_stereo(scene.camera))
    if settings.light is Light.TRACED and not compat.has_openimagedenoise():
        report.approximated(scene.name, "this Blender lacks OpenImageDenoise, so direct light is noisy: raise "
                                        "Samples, or set Light to Network Alone")
    names = passes.of_session(layer, passes.divided_light(layer, settings.light_passes))
    names += passes.REFERENCE if settings.reference else ()
    longest = max((p.blender_name for p in names), key=len)
    if (room := LONGEST_NAME - len(f".{longest}.X")) < len(layer.name.encode()):
        report.approximated(layer.name, "Blender shortens names in multilayer files: give the view layer a name of at "
                                        f'most {room} letters, or passes such as "{longest}" are lost')
