# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds that scenes take to become tokens, beside the published network's on the same number of triangles.

    python -m tools.benchmark.conversion [SCENE.blend ...] [--budgets 4096,16384,65536] [--resolutions 512,1408]

Without files: a mesh of a million triangles, and a million triangles in 500 objects, all of them visible. Prints one
line of JSON: per scene its triangles and per Max Triangles the triangles that remain, the seconds of all that happens
between Blender and the network, the longest time between two reports at Esc, and for each resolution the seconds' share
of those of the published network's forward (random weights) for that many triangles, measured in the same run. A
picture of 1408x1408 has about as many pixels as one of 1920x1080.
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from tools import extension
from tools.common.console import numbers, reserve_stdout

from .points import MeasurementError, measure_point

RESOLUTION = 512  # of the view that triangles are shared out by
SIDE = 708    # squares along the mesh of a million triangles
OBJECTS = 500


def main() -> int:
    arguments = _parse_arguments()
    answer = reserve_stdout()
    try:
        published = {budget: {resolution: _time_published(budget, resolution) for resolution in arguments.resolutions}
                     for budget in arguments.budgets}
    except MeasurementError as error:
        print(error, file=sys.stderr)
        return 1
    extension.load().register()
    from tools.common.scene_file import open_scene
    results = {}
    for name, scene in [*((str(path), lambda path=path: open_scene(path)) for path in arguments.scenes)] or [
            ("one mesh", _build_mesh), (f"{OBJECTS} objects", _build_objects)]:
        scene()
        results[name] = [_measure(budget, published[budget]) for budget in arguments.budgets]
    print(json.dumps(results), file=answer, flush=True)
    return 0


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark.conversion", description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=Path, nargs="*", help=".blend files")
    parser.add_argument("--budgets", type=numbers, default=(4096, 16384, 65536))
    parser.add_argument("--resolutions", type=numbers, default=(512, 1408))
    return parser.parse_args()


def _time_published(triangles: int, resolution: int) -> float:
    """Seconds of the forward."""
    return measure_point({"subject": "rf2_200m", "triangles": triangles, "resolution": resolution, "samples": 0,
                          "precision": "auto", "threads": 0})["seconds"]


def _measure(budget: int, published: dict[int, float]) -> dict:
    import bpy

    from renderformer_v2.model import progress
    from renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
    from renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
    from renderformer_v2.rf2_engine.convert.data.report import Report
    from renderformer_v2.rf2_engine.convert.scene import convert
    depsgraph = bpy.context.evaluated_depsgraph_get()
    options = ConversionOptions(budget, bpy.context.scene.renderformer_v2.max_edge)
    view, reports = convert_camera(depsgraph, RESOLUTION, RESOLUTION, None), [time.perf_counter()]
    with progress.reporting(lambda *_: reports.append(time.perf_counter())):
        tokens = len(convert(depsgraph, view, options, Report()))
    reports.append(time.perf_counter())
    seconds = reports[-1] - reports[0]
    return {"triangles": sum(map(_count_triangles, depsgraph.object_instances)), "budget": budget, "remaining": tokens,
            "seconds": round(seconds, 3), "longest_wait": round(max(b - a for a, b in zip(reports, reports[1:])), 4),
            "share_of_published": {resolution: round(seconds / full, 3) for resolution, full in published.items()}}


def _count_triangles(instance) -> int:
    if instance.object.type != "MESH":
        return 0
    instance.object.data.calc_loop_triangles()
    return len(instance.object.data.loop_triangles)


def _build_mesh() -> None:
    import bpy
    import numpy as np
    _open_empty_scene()
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=SIDE, y_subdivisions=SIDE, size=4)
    mesh = bpy.context.object.data
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", positions)
    x, y, z = positions.reshape(-1, 3).T
    z[:] = 0.3 * np.sin(3 * x) * np.cos(2 * y) + 0.002 * np.sin(40 * x) * np.sin(37 * y)
    mesh.vertices.foreach_set("co", positions)
    mesh.shade_smooth()


def _build_objects() -> None:
    import bpy
    _open_empty_scene()
    for i in range(OBJECTS):
        bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=32, radius=0.12,
                                             location=(i % 25 / 6 - 2, i // 25 / 5 - 2, 0))


def _open_empty_scene() -> None:
    """A camera above, and a lamp."""
    import bpy
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.engine = "RENDERFORMER_V2"
    bpy.ops.object.light_add(type="AREA", location=(0, 0, 6))
    bpy.ops.object.camera_add(location=(0, -6, 5), rotation=(0.88, 0, 0))
    bpy.context.scene.camera = bpy.context.object


if __name__ == "__main__":
    sys.exit(extension.run(main))
