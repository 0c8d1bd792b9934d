# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a .blend file of a scene of the authors' code: a prepared frame's folder, an H5 scene, or a scene of version 1.

    python -m tools.import_scene FRAME_DIR|SCENE.h5|SCENE.json -o SCENE.blend [--resolution N]

Prints a line of JSON: the scene, its triangles, and what is missing or was approximated. An error is one line on stderr
and exit status 1; wrong arguments are explained with exit status 2.
"""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from renderformer_v2.model.errors import SceneError

from . import extension
from .common.console import file_with, reserve_stdout, to_one_line, whole_number
from .common.pictures import check_output


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.import_scene", description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path, help="folder of a prepared frame, .h5 scene, or .json scene of version 1")
    parser.add_argument("-o", "--output", type=file_with(".blend"), required=True)
    parser.add_argument("--resolution", type=whole_number(64), default=512,
                        help="width and height of the picture in pixels (default: 512)")
    arguments = parser.parse_args()
    answer = reserve_stdout()
    try:
        statistics = _import(arguments)
    except (SceneError, RuntimeError, OSError) as error:
        print(to_one_line(error), file=sys.stderr)
        return 1
    print(json.dumps(statistics), file=answer, flush=True)
    return 0


def _import(arguments: argparse.Namespace) -> dict:
    import bpy
    check_output(arguments.output)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    extension.load().register()
    from renderformer_v2.rf2_engine.convert.data.report import Report
    from renderformer_v2.rf2_engine.paper_scenes.scene_import import import_scene
    report, empty = Report(), bpy.context.scene
    scene = import_scene(arguments.scene, report, arguments.resolution)
    bpy.context.window.scene = scene
    bpy.data.scenes.remove(empty)
    bpy.ops.wm.save_as_mainfile(filepath=str(arguments.output), relative_remap=True)
    triangles = sum(len(it.data.polygons) for it in scene.objects if it.type == "MESH")
    return {"scene": scene.name, "triangles": triangles, "cameras": sum(it.type == "CAMERA" for it in scene.objects),
            "report": report.lines(), "output": [str(arguments.output)]}


if __name__ == "__main__":
    extension.run(main)
