# SPDX-License-Identifier: GPL-3.0-or-later
"""Render H5 scenes of the authors' code, as many as are named, with the published weights.

    python -m tools.h5.render SCENE.h5|FOLDER|LIST.txt -o DIR --weights DIR [--resolution N] [--first-view-only]
        [--view-batch-size N] [--device D] [--precision P] [--tone-mapper M] [--video]
    python -m tools.h5.render SCENE.h5|FOLDER|LIST.txt --weights DIR --validate-only

Every view becomes DIR/NAME_view_0.exr, ... (linear), and a PNG of the same name; --video joins these, in the order of
files and views, in DIR/video.mp4. A list holds a path a line, relative to itself, and perhaps a tone mapper after it.
--tone-mapper standard (the default) is the sRGB curve, none plain numbers as the authors' code writes them, and agx,
filmic and pbr_neutral are Blender's. Raw files and those of version 1 are encoded first. --validate-only reads all
files and the weights, and draws nothing. Prints a line of JSON for each file; an error is one line on stderr and exit
status 1.
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from renderformer_v2.model.compute.devices import choose_device
from renderformer_v2.model.compute.precision import CHOICES
from renderformer_v2.model.compute.threads import team
from renderformer_v2.model.errors import CheckpointError, SceneError
from renderformer_v2.model.published.h5 import read_h5
from renderformer_v2.model.published.pipeline import PublishedPipeline
from renderformer_v2.model.published.processed_scene import ProcessedScene
from renderformer_v2.model.renderer import Renderer
from tools import extension
from tools.common.console import device_name, reserve_stdout, to_one_line, whole_number
from tools.common.pictures import check_output
from tools.common.tone_mapping import STANDARD, TONE_MAPPERS

from .inputs import list_inputs
from .pictures import save_picture

VIDEO = "video.mp4"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.h5.render", description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=Path, help=".h5 scene, a folder of them, or a list of paths")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR")
    parser.add_argument("--weights", required=True, metavar="DIR", help="the published bundle")
    parser.add_argument("--resolution", type=whole_number(1), default=512, help="pixels of a side (default: 512)")
    parser.add_argument("--first-view-only", action="store_true")
    parser.add_argument("--view-batch-size", type=whole_number(1), default=1, metavar="N",
                        help="views drawn at once (default: 1)")
    parser.add_argument("--device", type=device_name, default="auto", help="auto, cpu, cuda, cuda:1 or mps")
    parser.add_argument("--precision", choices=CHOICES, default="auto")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="processor threads (default: all)")
    parser.add_argument("--tone-mapper", choices=TONE_MAPPERS, default=STANDARD, help="of the PNG files")
    parser.add_argument("--video", action="store_true", help=f"also {VIDEO}")
    parser.add_argument("--validate-only", action="store_true")
    options = parser.parse_args()
    if bool(options.output) == options.validate_only:
        parser.error("one of -o and --validate-only is needed")
    answer = reserve_stdout()
    try:
        with team(options.threads):
            for line in (validate if options.validate_only else render)(options):
                print(json.dumps(line), file=answer, flush=True)
    except (SceneError, CheckpointError, ValueError, OSError) as error:
        print(to_one_line(error), file=sys.stderr)
        return 1
    return 0


def validate(options: argparse.Namespace):
    """Yield a line for each file that can be rendered. Raises what is wrong with the first that cannot, or with the
    weights."""
    inputs = list_inputs(options.scenes)
    pipeline = PublishedPipeline(options.weights, choose_device("cpu"), None)
    pipeline.load(pipeline.variant(options.resolution))
    for path, _ in inputs:
        scene = read(path, options)
        pipeline.encoder.require_known(scene)
        yield describe(path, scene)


def render(options: argparse.Namespace):
    """Write the pictures of one file after the other and yield a line for each."""
    inputs, saved = list_inputs(options.scenes), []
    check_output(options.output / VIDEO)
    renderer = Renderer(options.weights, options.device, options.precision)
    for path, mapper in inputs:
        scene, begin = read(path, options), time.perf_counter()
        try:
            pictures = renderer.render(scene, resolution=options.resolution, batch=options.view_batch_size)
        except (SceneError, CheckpointError) as error:
            raise type(error)(f"{path}: {error}") from error
        seconds = time.perf_counter() - begin
        files = [options.output / f"{path.stem}_view_{i}.exr" for i in range(len(pictures))]
        for file, picture in zip(files, pictures, strict=True):
            save_picture(file, picture)
            save_picture(file.with_suffix(".png"), picture, mapper or options.tone_mapper)
            saved.append(file.with_suffix(".png"))
        yield describe(path, scene) | {"seconds": round(seconds, 3), "computed_on": renderer.computed_on,
                                       "tone_mapper": mapper or options.tone_mapper, "output": list(map(str, files))}
    if options.video:
        from tools.common.video import write_video
        write_video(options.output / VIDEO, saved)
        yield {"video": str(options.output / VIDEO), "frames": len(saved)}


def read(path: Path, options: argparse.Namespace) -> ProcessedScene:
    scene = read_h5(path)
    return scene.first_view() if options.first_view_only else scene


def describe(path: Path, scene: ProcessedScene) -> dict:
    texture = "version 1" if scene.is_v1 else "raw" if scene.is_raw else "encoded"
    return {"scene": str(path), "triangles": len(scene.triangles), "views": len(scene.fov), "texture": texture,
            "volume_cells": 0 if scene.volumes is None else len(scene.volumes)}


if __name__ == "__main__":
    extension.run(main)
