# SPDX-License-Identifier: GPL-3.0-or-later
"""Check a view layer before it is rendered: what cannot be rendered, what will be missing, what is ignored."""
from __future__ import annotations

import bpy

from ...model.errors import SceneError
from ...model.published.bundle_files import check_weights
from ...model.weights.presets import weights_folder
from .. import compat, passes
from ..convert.camera.eyes import has_spherical_stereo, no_spherical_stereo
from ..convert.data.report import Report
from ..frame_settings import FrameSettings, Light
from ..runtime import device

LONGEST_NAME = 63  # bytes of view layer, pass and channel together, of every engine, in a multilayer file
USUAL_BOUNCES = 4  # diffuse bounces that Cycles traces by default


def check(depsgraph: bpy.types.Depsgraph, settings: FrameSettings, report: Report) -> None:
    """Report what the picture lacks and which settings of scene, view layer, objects and lamps are ignored.

    Raises SceneError and CheckpointError for what cannot be rendered.
    """
    check_weights(weights_folder(settings.weights))
    device.require(settings.device)
    scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    if scene.render.use_multiview and scene.render.views_format == "STEREO_3D" and has_spherical_stereo(scene.camera):
        raise SceneError(no_spherical_stereo(scene.camera))
    if settings.light is Light.TRACED and not compat.has_openimagedenoise():
        report.approximated(scene.name, "this Blender lacks OpenImageDenoise, so estimates alone remove the noise of "
                                        "traced light: raise Max Samples where some is left")
    names = passes.session_passes(layer, passes.needed_light(layer, settings.light_passes))
    names += [*passes.light_groups(layer, settings.light_passes), *(passes.REFERENCE if settings.reference else ())]
    longest = max((p.blender_name for p in names), key=len)
    if (room := LONGEST_NAME - len(f".{longest}.X")) < len(layer.name.encode()):
        report.approximated(layer.name, "Blender shortens names in multilayer files: give the view layer a name of at "
                                        f'most {room} letters, or passes such as "{longest}" are lost')
    report_ignored_settings(depsgraph, settings.light_passes, report)


def report_ignored_settings(depsgraph: bpy.types.Depsgraph, light_passes: frozenset[str], report: Report) -> None:
    """light_passes: keys of those that the weights can give."""
    scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    cycles = scene.cycles
    if not light_passes and min(cycles.max_bounces, cycles.diffuse_bounces) < USUAL_BOUNCES:
        report.approximated(scene.name, "the bounces set in Light Paths are ignored by the published weights")
    if cycles.use_fast_gi:
        report.approximated(scene.name, "Fast GI Approximation is ignored")
    if scene.render.use_simplify and (cycles.use_camera_cull or cycles.use_distance_cull):
        report.approximated(scene.name, "objects that Simplify's culling hides still light the scene and cast shadows")
    for name in passes.absent(scene, layer, light_passes):
        report.skipped(f"Pass {name}", "this pass of Cycles is not available")
    for obj in depsgraph.objects:
        if not light_passes and obj.type == "LIGHT" and obj.data.cycles.max_bounces < USUAL_BOUNCES:
            report.approximated(obj.name, "its Max Bounces is ignored by the published weights")
        elif obj.type == "MESH" and compat.is_diced(obj, scene):
            report.approximated(obj.name, "the network gets a coarser mesh than Adaptive Subdivision makes")
