# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure how much pictures flicker from frame to frame, compared with Cycles.

    python -m tools.flicker SCENE.blend -o DIR [--frames 24] [--degrees 1] [--samples 1024 ...] [--resolution WxH]
                            [--light TRACED|NETWORK] [--guide-samples N] [--weights rf2_small|DIR] [--threads N]
                            [--film FILE.webp]

The camera turns about the scene by --degrees a frame while the file's animation is played; with --degrees 0 it moves as
in the file. Both engines render every frame, Cycles with --samples and else as the file says; frames that are in DIR
already are not rendered again. Every pixel's world position (pass Position) is looked up in the next frame, and where
that sees the same spot the two colours are compared. Prints one line of JSON: per engine ("cycles" has the first number
of samples, "cycles_16" another) the mean absolute sRGB difference of all pixels that are compared ("flicker", of 1),
their median, their share of the picture, and the mean of every pair of frames; and "ratio", the flicker of all others
over that of the first Cycles, likewise of the medians. Silhouettes and mirrors change with the camera in both engines
and make most of the mean, and none of the median. --film shows the frames of all, side by side in that order.
"""
from __future__ import annotations

import argparse
import json
import statistics
import sys
from itertools import pairwise
from pathlib import Path

from renderformer_v2.model.errors import CheckpointError, SceneError
from tools import extension
from tools.common.console import picture_size, reserve_stdout, to_one_line, whole_number
from tools.common.pictures import check_output, read_pass
from tools.common.scene_file import LIGHTS


def main() -> int:
    arguments = _parse_arguments()
    answer = reserve_stdout()
    extension.load().register()
    try:
        if not arguments.scene.is_file():
            raise FileNotFoundError(f"{arguments.scene}: there is no such file")
        if arguments.film:
            check_output(arguments.film)
        engines = {"renderformer": _measure(arguments, "renderformer", samples=arguments.guide_samples,
                                            light=arguments.light, weights=arguments.weights)}
        for number, samples in enumerate(arguments.samples):
            name = f"cycles_{samples}" if number else "cycles"
            engines[name] = _measure(arguments, "cycles", samples=samples)
        if arguments.film:
            _write_film(arguments.film, [Path(engine["folder"]) for engine in engines.values()])
    except (CheckpointError, SceneError, RuntimeError, ValueError, OSError) as error:
        print(to_one_line(error), file=sys.stderr)
        return 1
    ratios = {"ratio": _compute_ratios(engines, "flicker"), "median_ratio": _compute_ratios(engines, "median")}
    print(json.dumps({"scene": str(arguments.scene), "frames": arguments.frames, "degrees": arguments.degrees,
                      "samples": arguments.samples} | engines | ratios), file=answer, flush=True)
    return 0


def _parse_arguments() -> argparse.Namespace:
    count = whole_number(1)
    parser = argparse.ArgumentParser(prog="python -m tools.flicker", description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path, help=".blend file")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--frames", type=whole_number(2), default=24)
    parser.add_argument("--degrees", type=float, default=1.0, help="a frame; 0 moves the camera as in the file")
    parser.add_argument("--samples", type=count, nargs="+", default=[1024], help="of Cycles")
    parser.add_argument("--resolution", type=picture_size, help="WxH in pixels (default: the file's)")
    parser.add_argument("--light", choices=LIGHTS, help="default: the file's")
    parser.add_argument("--guide-samples", type=count, help="default: the file's")
    parser.add_argument("--weights", help="rf2_small, or a folder with weights (default: the file's)")
    parser.add_argument("--threads", type=count, help="processor threads (default: the file's)")
    parser.add_argument("--film", type=Path, metavar="FILE.webp", help="animated picture of all frames")
    return parser.parse_args()


def _measure(arguments: argparse.Namespace, engine: str, **settings) -> dict:
    """The frames of an engine, compared; settings: of RenderOptions."""
    from .frames import read_frame, render_frames
    from .measure import measure_flicker
    frames = render_frames(arguments.scene, arguments.output.resolve(), engine, arguments.frames, arguments.degrees,
                           resolution=arguments.resolution, threads=arguments.threads, **settings)
    pairs = [measure_flicker(before, after) for before, after in pairwise(read_frame(*frame) for frame in frames)]
    mean, median, compared = map(statistics.mean, zip(*pairs))
    return {"flicker": round(mean, 6), "median": round(median, 6), "compared": round(compared, 4),
            "pairs": [round(change.mean, 6) for change in pairs], "folder": str(frames[0][1].parent)}


def _write_film(path: Path, folders: list[Path]) -> None:
    from .frames import write_film
    frames = zip(*(sorted(folder.glob("*.exr")) for folder in folders), strict=True)
    write_film(path, ([read_pass(file, "Combined", "RGB") for file in files] for files in frames))


def _compute_ratios(engines: dict[str, dict], key: str) -> dict[str, float | None]:
    """Values of all engines over that of "cycles"; None where its pictures do not change."""
    reference = engines["cycles"][key]
    return {name: round(engine[key] / reference, 3) if reference else None
            for name, engine in engines.items() if name != "cycles"}


if __name__ == "__main__":
    extension.run(main)
