# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a .blend file as F12 would, or an H5 scene; or write the H5 scene of a .blend file.

    python -m tools.render SCENE.blend -o OUT.exr [--engine cycles] [--samples N] [--resolution WxH]
                           [--weights rf2_small|DIR] [--threads N] [--verbose]
    python -m tools.render SCENE.blend --export-h5 SCENE.h5 --weights DIR
    python -m tools.render SCENE.h5 -o OUT.exr --weights DIR [--resolution RxR]

The H5 scenes are those of the research code; DIR is then the published bundle. Several cameras make OUT_000.exr, ....
Writes a multilayer EXR, or a PNG, by suffix (-o may be repeated) and prints one line of JSON: seconds by stage, tokens,
triangles, and what was approximated or skipped; of several view layers the sums, and each under "layers". An error is
one line on stderr and exit status 1; wrong arguments are explained with exit status 2.
"""
from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

from renderformer_v2.model import threads
from renderformer_v2.model.errors import CheckpointError, SceneError
from renderformer_v2.model.presets import BUNDLED

from . import extension
from .arguments import whole_number
from .picture import write_whole

FORMATS = {".exr": "OPEN_EXR_MULTILAYER", ".png": "PNG"}
H5 = (".h5", ".hdf5")
_count = whole_number(1)


def main() -> int:
    arguments = _arguments()
    answer = os.fdopen(os.dup(1), "w")
    os.dup2(2 if arguments.verbose else os.open(os.devnull, os.O_WRONLY), 1)  # Blender's talk is not the answer
    try:
        statistics = _run(arguments)
    # Blender raises RuntimeError for whatever the engine reports.
    except (CheckpointError, SceneError, RuntimeError, ValueError, OSError) as error:
        messages = dict.fromkeys(line.removeprefix("Error: ").strip() for line in str(error).splitlines())
        print(" ".join(filter(None, messages)), file=sys.stderr)
        return 1
    print(json.dumps(statistics), file=answer, flush=True)
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.render", description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path, help=".blend file, or .h5 scene")
    parser.add_argument("-o", "--output", type=_file(*FORMATS), action="append", default=[],
                        help="picture: .exr or .png")
    parser.add_argument("--export-h5", type=_file(*H5), metavar="FILE", help="write the scene for the research code")
    parser.add_argument("--engine", choices=("renderformer", "cycles"), default="renderformer")
    parser.add_argument("--samples", type=_count, help="samples, or Cycles' samples (default: the file's)")
    parser.add_argument("--resolution", type=_resolution, help="WxH in pixels (default: the file's)")
    parser.add_argument("--weights", type=_weights, help=f"{BUNDLED}, or a folder with weights (default: the file's)")
    parser.add_argument("--threads", type=_count, help="processor threads (default: the file's)")
    parser.add_argument("--verbose", action="store_true", help="Blender's own output on stderr")
    arguments = parser.parse_args()
    if bool(arguments.output) == bool(arguments.export_h5):
        parser.error("one of -o and --export-h5 is needed")
    return arguments


def _file(*suffixes: str):
    def parse(text: str) -> Path:
        path = Path(text).resolve()
        if path.suffix.lower() not in suffixes:
            raise argparse.ArgumentTypeError(f"{text}: the suffix must be one of {', '.join(suffixes)}")
        return path
    return parse


def _resolution(text: str) -> tuple[int, int]:
    sides = text.lower().split("x")
    if len(sides) != 2:
        raise argparse.ArgumentTypeError(f"{text}: expected WIDTHxHEIGHT, such as 640x480")
    return _count(sides[0]), _count(sides[1])


def _weights(text: str) -> str:
    if not text.strip():
        raise argparse.ArgumentTypeError(f"expected {BUNDLED}, or a folder with weights")
    return text


def _run(arguments: argparse.Namespace) -> dict:
    if not arguments.scene.is_file():
        raise FileNotFoundError(f"{arguments.scene}: there is no such file")
    is_h5 = arguments.scene.suffix.lower() in H5
    if is_h5 and arguments.export_h5:
        raise ValueError(f"{arguments.scene} is an H5 scene already: --export-h5 is for .blend files")
    if (is_h5 or arguments.export_h5) and (arguments.engine == "cycles" or arguments.samples):
        raise ValueError("H5 scenes are for the published network alone: leave out --engine cycles and --samples")
    for path in filter(None, (*arguments.output, arguments.export_h5)):
        _prepare(path)
    if is_h5:
        from . import h5_scene
        with threads.team(arguments.threads or 0):
            return h5_scene.render(arguments.scene, arguments.weights, arguments.output, arguments.resolution)
    import bpy
    extension.load().register()
    bpy.ops.wm.open_mainfile(filepath=str(arguments.scene.resolve()))
    scene = bpy.context.scene
    if not any(layer.use for layer in scene.view_layers):
        raise ValueError(f'no view layer of scene "{scene.name}" is enabled for rendering: '
                         "switch on Use for Rendering in View Layer Properties")
    _apply(arguments, scene)
    if arguments.export_h5:
        from . import h5_scene
        return h5_scene.export(scene, arguments.weights, arguments.export_h5)
    return _render(arguments, scene)


def _prepare(path: Path) -> None:
    """Make the folder of an output and try it, before the work rather than after. Raises OSError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise OSError(f"{path} cannot be written: {error.strerror}") from error
    if path.is_dir():
        raise OSError(f"{path} cannot be written: it is a folder")


def _render(arguments: argparse.Namespace, scene) -> dict:
    import bpy
    begin = time.perf_counter()
    bpy.ops.render.render(scene=scene.name)
    seconds = time.perf_counter() - begin
    for path in arguments.output:
        _save(path, scene)

    statistics = {"scene": str(arguments.scene), "engine": scene.render.engine, "seconds": {"total": round(seconds, 3)},
                  "tokens": None, "triangles": None, "report": [], "output": list(map(str, arguments.output))}
    from renderformer_v2.rf2_engine.statistics import last_frame
    # Without the engine there are none: Cycles rendered, or compositor or sequencer made the picture alone.
    if last_frame:
        layers = [_of_layer(layer) for layer in last_frame]
        stages = dict.fromkeys(stage for layer in layers for stage in layer["seconds"])
        statistics["seconds"] = {stage: round(sum(layer["seconds"].get(stage, 0.0) for layer in layers), 3)
                                 for stage in stages} | statistics["seconds"]
        statistics |= {key: sum(layer[key] for layer in layers) for key in ("tokens", "triangles")}
        statistics |= {key: layers[-1][key] for key in ("size", "weights")}
        statistics["report"] = [line for layer in layers for line in layer["report"]]
        if len(layers) > 1:
            statistics["layers"] = layers
    return statistics


def _of_layer(layer) -> dict:
    return {key: getattr(layer, key) for key in ("layer", "size", "triangles", "tokens", "weights", "report")} | {
        "seconds": {stage: round(seconds, 3) for stage, seconds in layer.seconds.items()}}


def _apply(arguments: argparse.Namespace, scene) -> None:
    cycles = arguments.engine == "cycles"
    scene.render.engine = "CYCLES" if cycles else "RENDERFORMER_V2"
    if arguments.samples:
        owner, name = (scene.cycles, "samples") if cycles else (scene.renderformer_v2, "guide_samples")
        setattr(owner, name, arguments.samples)
    if arguments.threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", arguments.threads
        scene.renderformer_v2.threads_mode = "AUTO"  # Blender's
    if arguments.resolution:
        scene.render.resolution_x, scene.render.resolution_y = arguments.resolution
        scene.render.resolution_percentage = 100
    if arguments.weights:
        scene.renderformer_v2.weights_source = "BUNDLED" if arguments.weights == BUNDLED else "FOLDER"
        scene.renderformer_v2.weights_folder = os.path.abspath(arguments.weights)


def _save(path: Path, scene) -> None:
    import bpy

    from renderformer_v2.rf2_engine.compat import set_file_format
    settings = scene.render.image_settings
    set_file_format(settings, FORMATS[path.suffix.lower()])
    if path.suffix.lower() == ".exr":
        settings.color_depth = "32"
    result = bpy.data.images["Render Result"]
    write_whole(path, lambda file: result.save_render(str(file), scene=scene))


if __name__ == "__main__":
    extension.run(main)
