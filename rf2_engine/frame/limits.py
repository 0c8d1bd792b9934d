# SPDX-License-Identifier: GPL-3.0-or-later
"""Report settings of scene, view layer, objects and lamps that this engine ignores."""
from __future__ import annotations

import bpy

from .. import compat, passes
from ..convert.data.report import Report
from ..settings import light_passes

USUAL_BOUNCES = 4  # diffuse bounces that Cycles traces unless told otherwise


def report_limits(depsgraph: bpy.types.Depsgraph, report: Report) -> None:
    scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    cycles = scene.cycles
    if min(cycles.max_bounces, cycles.diffuse_bounces) < USUAL_BOUNCES:
        report.approximated(scene.name, "the bounces set in Light Paths are ignored")
    if cycles.use_fast_gi:
        report.approximated(scene.name, "Fast GI Approximation is ignored")
    if scene.render.use_simplify and (cycles.use_camera_cull or cycles.use_distance_cull):
        report.approximated(scene.name, "objects that Simplify's culling hides still light the scene and cast shadows")
    if absent := passes.absent(scene, layer, light_passes(scene)):
        report.skipped(layer.name, f"these passes of Cycles are not available: {', '.join(absent)}")
    for obj in depsgraph.objects:
        if obj.type == "LIGHT" and obj.data.cycles.max_bounces < USUAL_BOUNCES:
            report.approximated(obj.name, "its Max Bounces is ignored")
        elif obj.type == "MESH" and compat.is_diced(obj, scene):
            report.approximated(obj.name, "the network gets a coarser mesh than Adaptive Subdivision makes")
