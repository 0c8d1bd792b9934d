# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.evaluate SCENE_DIR -o REPORT_DIR: how close the engine is to Cycles.

SCENE_DIR holds samples of `python -m tools.datagen` (the RenderScene that the engine makes, and Cycles references), or
.blend files, which are rendered by both engines with the settings they hold. Prints one JSON object with PSNR, SSIM,
FLIP and HDR-FLIP per scene and their means; REPORT_DIR gets the same as report.json, and as report.html, a page with
the pictures. Samples are also set beside what each ingredient alone gives: the traced light (traced_alone), with
bounced light, which is what the network corrects (without_network), Network and Rays (network_and_rays), what that
corrects (rays_alone), and Transformer Alone (transformer_alone); all scenes beside Cycles with few samples and
OpenImageDenoise (cycles_equal): `tools.datagen --equal N` for samples, as many as take about the engine's time for
.blend files, or as --cycles says. References of .blend files are kept in REPORT_DIR/renders and not rendered again
while file and --reference are the same.
"""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from renderformer_v2.model.compute.threads import team
from renderformer_v2.model.errors import CheckpointError
from renderformer_v2.model.weights.presets import BUNDLED
from tools.common.console import whole_number
from tools.datagen.sample_files import sample_paths

from .blends import evaluate_blend
from .report import write_page, write_pictures
from .samples import Renderers, evaluate_sample
from .scores import compute_means


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.evaluate", description=__doc__)
    parser.add_argument("scenes", type=Path, metavar="SCENE_DIR")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="REPORT_DIR")
    parser.add_argument("--weights", default=BUNDLED, help="a preset with weights, or a folder")
    parser.add_argument("--cycles", type=whole_number(1), nargs="+", default=(), metavar="N",
                        help="of .blend files: also Cycles with each of so many samples, instead of in equal time")
    parser.add_argument("--reference", type=whole_number(1), metavar="N",
                        help="of .blend files: samples of the reference, without Clamp Indirect (default: the file's)")
    parser.add_argument("--limit", type=int, help="only the first LIMIT scenes")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="processor threads (default: all)")
    options = parser.parse_args()
    paths = [*sample_paths(options.scenes), *sorted(options.scenes.glob("*.blend"))][: options.limit]
    if not paths:
        print(f"no scenes in {options.scenes}: make some with python -m tools.datagen, or put .blend files there",
              file=sys.stderr)
        return 2
    options.output.mkdir(parents=True, exist_ok=True)
    try:
        report = evaluate(paths, options)
    except (CheckpointError, RuntimeError) as error:  # Blender's, of a .blend file
        print(error, file=sys.stderr)
        return 1
    print(json.dumps(report))
    return 0


def evaluate(paths: list[Path], options: argparse.Namespace) -> dict:
    """Write pictures, and after every scene report.json and report.html; return the report.

    Raises CheckpointError and RuntimeError.
    """
    renderers, scenes, pictures = None, {}, {}
    for path in paths:
        if path.suffix == ".blend":
            evaluation = evaluate_blend(path, options.weights, options.output / "renders", options.threads,
                                        options.cycles, options.reference)
        else:
            renderers = renderers or Renderers.of(options.weights)
            with team(options.threads):
                evaluation = evaluate_sample(path, renderers)
        scenes[path.stem] = evaluation.scores
        pictures[path.stem] = write_pictures(evaluation, options.output, path.stem)
        report = {"weights": options.weights, "scenes": scenes, "mean": compute_means(list(scenes.values()))}
        (options.output / "report.json").write_text(json.dumps(report, indent=1))
        write_page(report, pictures, options.output / "report.html")
    return report


if __name__ == "__main__":
    sys.exit(main())
