# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a .blend file as F12 would, or an H5 scene; or write the H5 scene of a .blend file.

    python -m tools.render SCENE.blend -o OUT.exr [--engine cycles] [--samples N] [--resolution WxH]
                           [--weights rf2_small|DIR] [--device D] [--precision P] [--threads N] [--verbose]
                           [--tone-mapper M]
                           [--beside-cycles [--reference-samples N] [--sheet OUT.png]]
    python -m tools.render SCENE.blend --export-h5 SCENE.h5 --weights DIR
    python -m tools.render SCENE.h5 -o OUT.exr --weights DIR [--resolution RxR]

The H5 scenes are those of the research code; DIR is then the published bundle. Several cameras make OUT_000.exr, ....
`python -m tools.h5.render` renders folders and lists of them, and videos.
--beside-cycles renders the Cycles reference into the same file, with PSNR, SSIM and FLIP under "comparison"; the sheet
shows both, their difference and FLIP.
Writes a multilayer EXR, or a PNG, by suffix (-o may be repeated) and prints one line of JSON: seconds by stage, tokens,
triangles, and what was approximated or skipped; of several view layers the sums, and each under "layers". An error is
one line on stderr and exit status 1; wrong arguments are explained with exit status 2.
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from renderformer_v2.model.compute import threads
from renderformer_v2.model.compute.precision import CHOICES
from renderformer_v2.model.errors import CheckpointError, SceneError
from renderformer_v2.model.weights.presets import BUNDLED
from tools import extension
from tools.common.console import (
    device_name,
    file_with,
    picture_size,
    reserve_stdout,
    to_one_line,
    whole_number,
)
from tools.common.pictures import check_output
from tools.common.scene_file import (
    ENGINES,
    FORMATS,
    LIGHTS,
    RenderOptions,
    configure,
    open_scene,
    save_picture,
)
from tools.common.tone_mapping import STANDARD, TONE_MAPPERS

H5 = (".h5", ".hdf5")


def main() -> int:
    arguments = _parse_arguments()
    answer = reserve_stdout(is_verbose=arguments.verbose)
    try:
        statistics = _run(arguments)
    # Blender raises RuntimeError for whatever the engine reports.
    except (CheckpointError, SceneError, RuntimeError, ValueError, OSError) as error:
        print(to_one_line(error), file=sys.stderr)
        return 1
    print(json.dumps(statistics), file=answer, flush=True)
    return 0


def _parse_arguments() -> argparse.Namespace:
    count = whole_number(1)
    parser = argparse.ArgumentParser(prog="python -m tools.render", description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path, help=".blend file, or .h5 scene")
    parser.add_argument("-o", "--output", type=file_with(*FORMATS), action="append", default=[],
                        help="picture: .exr or .png")
    parser.add_argument("--export-h5", type=file_with(*H5), metavar="FILE",
                        help="write the scene for the research code")
    parser.add_argument("--engine", choices=ENGINES, default="renderformer")
    parser.add_argument("--samples", type=count, help="samples, or Cycles' samples (default: the file's)")
    parser.add_argument("--light", choices=LIGHTS, help="With Cycles, Network and Rays, or Transformer Alone "
                                                        "(default: the file's)")
    parser.add_argument("--unclamped", action="store_true", help="Cycles without Clamp Indirect")
    parser.add_argument("--resolution", type=picture_size, help="WxH in pixels (default: the file's)")
    parser.add_argument("--weights", type=_parse_weights,
                        help=f"{BUNDLED}, or a folder with weights (default: the file's)")
    parser.add_argument("--triangles", type=count, help="Max Triangles (default: the file's)")
    parser.add_argument("--device", type=device_name, help="auto, cpu, cuda, cuda:1 or mps (default: the file's)")
    parser.add_argument("--precision", choices=CHOICES, help="of the network (default: the file's)")
    parser.add_argument("--threads", type=count, help="processor threads (default: the file's)")
    parser.add_argument("--tone-mapper", choices=TONE_MAPPERS,
                        help=f"of PNG files (default: the file's; of an H5 scene: {STANDARD})")
    parser.add_argument("--beside-cycles", action="store_true", help="a Cycles reference of the same scene, compared")
    parser.add_argument("--reference-samples", type=count, help="of that reference (default: the file's)")
    parser.add_argument("--sheet", type=file_with(".png"), help="picture of that comparison")
    parser.add_argument("--verbose", action="store_true", help="Blender's own output on stderr")
    arguments = parser.parse_args()
    if bool(arguments.output) == bool(arguments.export_h5):
        parser.error("one of -o and --export-h5 is needed")
    if (arguments.sheet or arguments.reference_samples) and not arguments.beside_cycles:
        parser.error("--sheet and --reference-samples are for --beside-cycles")
    if arguments.beside_cycles and (arguments.engine == "cycles" or not arguments.output):
        parser.error("--beside-cycles is for pictures of RenderFormer-V2")
    return arguments


def _parse_weights(text: str) -> str:
    if not text.strip():
        raise argparse.ArgumentTypeError(f"expected {BUNDLED}, or a folder with weights")
    return text


def _run(arguments: argparse.Namespace) -> dict:
    if not arguments.scene.is_file():
        raise FileNotFoundError(f"{arguments.scene}: there is no such file")
    is_h5 = arguments.scene.suffix.lower() in H5
    if is_h5 and arguments.export_h5:
        raise ValueError(f"{arguments.scene} is an H5 scene already: --export-h5 is for .blend files")
    if (is_h5 or arguments.export_h5) and (
            arguments.engine == "cycles" or arguments.samples or arguments.beside_cycles):
        raise ValueError("H5 scenes are for the published network alone: leave out --engine cycles, --samples and "
                         "--beside-cycles")
    for path in filter(None, (*arguments.output, arguments.export_h5, arguments.sheet)):
        check_output(path)
    if is_h5:
        from . import h5_scene
        with threads.team(arguments.threads or 0):
            return h5_scene.render(arguments.scene, arguments.weights, arguments.output, arguments.resolution,
                                   arguments.device or "auto", arguments.precision or "auto",
                                   arguments.tone_mapper or STANDARD)
    extension.load().register()
    scene = open_scene(arguments.scene)
    configure(scene, RenderOptions(
        arguments.engine, samples=arguments.samples, resolution=arguments.resolution, weights=arguments.weights,
        threads=arguments.threads, light=arguments.light, with_reference=arguments.beside_cycles,
        reference_samples=arguments.reference_samples, unclamped=arguments.unclamped, device=arguments.device,
        precision=arguments.precision, triangles=arguments.triangles, tone_mapper=arguments.tone_mapper))
    if arguments.export_h5:
        from . import h5_scene
        return h5_scene.export(scene, arguments.weights, arguments.export_h5)
    return _render(arguments, scene)


def _render(arguments: argparse.Namespace, scene) -> dict:
    """Render and save the open scene; returns its statistics."""
    import bpy
    begin = time.perf_counter()
    bpy.ops.render.render(scene=scene.name)
    seconds = time.perf_counter() - begin
    for path in arguments.output:
        save_picture(path, scene)

    statistics = {"scene": str(arguments.scene), "engine": scene.render.engine, "seconds": {"total": round(seconds, 3)},
                  "tokens": None, "triangles": None, "report": [], "output": list(map(str, arguments.output))}
    if arguments.engine == "cycles":
        statistics["samples"] = scene.cycles.samples
    from renderformer_v2.rf2_engine.progress.frame_lines import describe_layer
    from renderformer_v2.rf2_engine.progress.last_render import last_frame
    # Without the engine there are none: Cycles rendered, or compositor or sequencer made the picture alone.
    if last_frame:
        layers = [describe_layer(layer) for layer in last_frame]
        if arguments.beside_cycles:
            _compare(layers, scene, arguments.sheet)
        statistics |= _combine(layers) | {"seconds": _add_seconds(layers) | statistics["seconds"]}
    return statistics


def _combine(layers: list[dict]) -> dict:
    """The statistics of all view layers, but for their seconds."""
    combined = {key: sum(layer[key] for layer in layers) for key in ("tokens", "triangles")}
    combined |= {key: layers[-1][key] for key in ("size", "weights", "device")}
    combined["report"] = [line for layer in layers for line in layer["report"]]
    if len(layers) > 1:
        return combined | {"layers": layers}
    return combined | {key: layers[0][key] for key in ("reference_samples", "comparison") if "comparison" in layers[0]}


def _add_seconds(layers: list[dict]) -> dict[str, float]:
    """The seconds of all view layers, by stage."""
    stages = dict.fromkeys(stage for layer in layers for stage in layer["seconds"])
    return {stage: round(sum(layer["seconds"].get(stage, 0.0) for layer in layers), 3) for stage in stages}


def _compare(layers: list[dict], scene, sheet: Path | None) -> None:
    """Add to the statistics of each view layer how close it is to its Cycles reference."""
    from renderformer_v2.rf2_engine.render_size import frame_size, render_border

    from .comparison import compare_layers
    settings = scene.render
    border = None if settings.use_crop_to_border else render_border(*frame_size(settings), settings)
    compare_layers(layers, lambda path: save_picture(path, scene), sheet, border)


if __name__ == "__main__":
    extension.run(main)
