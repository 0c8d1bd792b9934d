# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of scene, view layer, objects and lamps that Cycles obeys and this engine does not: a line each."""
from __future__ import annotations

import bpy

from .. import compat, passes
from ..convert.report import Report
from ..settings import light_passes

USUAL_BOUNCES = 4  # diffuse bounces that Cycles traces unless told otherwise


def report_limits(depsgraph: bpy.types.Depsgraph, report: Report) -> None:
    scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    cycles = scene.cycles
    if min(cycles.max_bounces, cycles.diffuse_bounces) < USUAL_BOUNCES:
        report.approximated(scene.name, "light bounces as often as it usually does, not as Light Paths say")
    if cycles.use_fast_gi:
        report.approximated(scene.name, "Fast GI Approximation is ignored: all light is the network's")
    if scene.render.use_simplify and (cycles.use_camera_cull or cycles.use_distance_cull):
        report.approximated(scene.name, "what Simplify's culling hides lights the scene and casts shadows all the same")
    if absent := passes.absent(scene, layer, light_passes(scene)):
        report.skipped(layer.name, f"there is no pass {', '.join(absent)}, which Cycles would give")
    for obj in depsgraph.objects:
        if obj.type == "LIGHT" and obj.data.cycles.max_bounces < USUAL_BOUNCES:
            report.approximated(obj.name, "its Max Bounces is ignored: its light bounces like any other")
        elif obj.type == "MESH" and compat.is_diced(obj, scene):
            report.approximated(obj.name, "the network's mesh is coarser than what Adaptive Subdivision makes")
