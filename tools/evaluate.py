# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.evaluate SCENE_DIR -o REPORT_DIR: how close the engine is to Cycles.

SCENE_DIR holds samples of `python -m tools.datagen` (the RenderScene that the engine makes, and Cycles references), or
.blend files, which are rendered by both engines with the settings they hold. Prints one JSON object with PSNR, SSIM and
FLIP per scene and their means; REPORT_DIR gets the same as report.json and one PNG per scene: each view's picture, then
its reference.
"""
from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from renderformer_v2.model.color import linear_to_srgb
from renderformer_v2.model.presets import BUNDLED
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.threads import team
from tools.arguments import whole_number
from tools.datagen.shards import load_sample, sample_paths
from tools.metrics import compare

ROOT = Path(__file__).parents[1]


def evaluate_sample(path: Path, renderer: Renderer) -> tuple[dict[str, float], np.ndarray]:
    """Mean metrics over the views of one sample, and its contact sheet (H, W, 3) in [0, 1]."""
    scene, views, guides, passes = load_sample(path)
    begin = time.perf_counter()
    encoded = renderer.encode(scene)
    pictures = [encoded.view(view, guide) + guide.emission + guide.environment
                for view, guide in zip(views, guides, strict=True)]
    seconds = time.perf_counter() - begin
    references = [p["combined"][..., :3] + guide.environment for p, guide in zip(passes, guides, strict=True)]
    return _scores(pictures, references, triangles=len(scene), seconds=seconds)


def evaluate_blend(path: Path, weights: str, output: Path, threads: int) -> tuple[dict[str, float], np.ndarray]:
    """The same for a .blend file. Raises RuntimeError with the engine's message if it cannot be rendered."""
    pictures, statistics = {}, {}
    for engine, options in (("renderformer", ["--weights", weights]), ("cycles", [])):
        exr = output / f"{path.stem}.{engine}.exr"
        command = [sys.executable, "-m", "tools.render", path.resolve(), "-o", exr.resolve(), "--engine", engine,
                   *(["--threads", threads] if threads else [])]
        done = subprocess.run([*map(str, command), *options], cwd=ROOT, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{path}: {done.stderr.strip()}")
        statistics[engine] = json.loads(done.stdout)
        pictures[engine] = read_combined(exr)
    return _scores([pictures["renderformer"]], [pictures["cycles"]], triangles=statistics["renderformer"]["triangles"],
                   seconds=statistics["renderformer"]["seconds"]["total"],
                   cycles_seconds=statistics["cycles"]["seconds"]["total"])


def read_combined(path: Path) -> np.ndarray:
    """(H, W, 3) f32 Combined of the first view layer of a multilayer EXR."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    layer = min(name.removesuffix(".R") for name in channels if name.endswith(".Combined.R"))
    return np.stack([channels[f"{layer}.{c}"] for c in "RGB"], axis=-1).astype(np.float32)


def _scores(pictures: list[np.ndarray], references: list[np.ndarray], **more) -> tuple[dict[str, float], np.ndarray]:
    pairs = list(zip(pictures, references, strict=True))
    views = [compare(a, b) for a, b in pairs]
    mean = {key: float(np.mean([v[key] for v in views])) for key in views[0]}
    rows = [np.concatenate([linear_to_srgb(a), linear_to_srgb(b)], axis=1) for a, b in pairs]
    return mean | {key: round(value, 3) for key, value in more.items()}, np.concatenate(rows, axis=0)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.evaluate", description=__doc__)
    parser.add_argument("scenes", type=Path, metavar="SCENE_DIR")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="REPORT_DIR")
    parser.add_argument("--weights", default=BUNDLED, help="a preset with weights, or a folder")
    parser.add_argument("--limit", type=int, help="only the first LIMIT scenes")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="processor threads (default: all)")
    options = parser.parse_args()
    paths = [*sample_paths(options.scenes), *sorted(options.scenes.glob("*.blend"))][: options.limit]
    if not paths:
        print(f"no scenes in {options.scenes}: make some with python -m tools.datagen, or put .blend files there",
              file=sys.stderr)
        return 2
    from skimage.io import imsave

    options.output.mkdir(parents=True, exist_ok=True)
    renderer, scenes = None, {}
    for path in paths:
        if path.suffix == ".blend":
            scenes[path.stem], sheet = evaluate_blend(path, options.weights, options.output, options.threads)
        else:
            renderer = renderer or Renderer(options.weights)
            with team(options.threads):
                scenes[path.stem], sheet = evaluate_sample(path, renderer)
        imsave(options.output / f"{path.stem}.png", (sheet * 255 + 0.5).astype(np.uint8), check_contrast=False)
    mean = {key: float(np.mean([s[key] for s in scenes.values()])) for key in ("psnr", "ssim", "flip")}
    report = {"weights": options.weights, "scenes": scenes, "mean": mean}
    (options.output / "report.json").write_text(json.dumps(report, indent=1))
    print(json.dumps(report))
    return 0


if __name__ == "__main__":
    sys.exit(main())
