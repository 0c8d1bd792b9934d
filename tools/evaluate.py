# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.evaluate SCENE_DIR -o REPORT_DIR: how close the engine is to Cycles.

SCENE_DIR holds samples of `python -m tools.datagen` (the RenderScene that the engine makes, and Cycles references), or
.blend files, which are rendered by both engines with the settings they hold. Prints one JSON object with PSNR, SSIM and
FLIP per scene and their means; REPORT_DIR gets the same as report.json and one PNG per scene: each view's picture, then
its reference. Samples are also set beside the traced light (traced_alone), that and a share of the radiosity,
which is what the network adds to (without_network), the network without traced hints (network_alone), and Cycles with
few samples and OpenImageDenoise (cycles_equal; `tools.datagen --equal N`).
"""
from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from renderformer_v2.model.color import linear_to_srgb
from renderformer_v2.model.guided.inputs import guided_view
from renderformer_v2.model.guided.light import OUTPUTS, decode_image
from renderformer_v2.model.guided.pipeline import GuidedContext
from renderformer_v2.model.presets import BUNDLED
from renderformer_v2.model.renderer import EncodedScene, Renderer
from renderformer_v2.model.scene import Guides, View
from renderformer_v2.model.threads import team
from tools.arguments import whole_number
from tools.datagen.shards import load_sample, sample_paths
from tools.metrics import compare
from tools.picture import read_pass

ROOT = Path(__file__).parents[1]
METRICS = ("psnr", "ssim", "flip")


def evaluate_sample(path: Path, renderer: Renderer) -> tuple[dict, np.ndarray]:
    """Mean metrics over the views of one sample and of what it is set beside, and its contact sheet (H, W, 3)."""
    scene, views, guides, passes = load_sample(path)
    begin = time.perf_counter()
    encoded = renderer.encode(scene)
    seen = list(zip(views, guides, strict=True))
    pictures = [encoded.view(view, guide) for view, guide in seen]
    seconds = time.perf_counter() - begin
    beside = {}
    if isinstance(encoded.encoded, GuidedContext) and guides[0].traced is not None:
        beside["traced_alone"] = [guide.traced for guide in guides]
        beside["without_network"] = [without_network(encoded, view, guide) for view, guide in seen]
        beside["network_alone"] = [encoded.view(view, replace(guide, traced=None)) for view, guide in seen]
    if "equal" in passes[0]:
        beside["cycles_equal"] = [p["equal"][..., :3] - guide.emission for p, guide in zip(passes, guides, strict=True)]

    def shown(surfaces: list[np.ndarray]) -> list[np.ndarray]:
        return [a + guide.emission + guide.environment for a, guide in zip(surfaces, guides, strict=True)]

    references = [p["combined"][..., :3] + guide.environment for p, guide in zip(passes, guides, strict=True)]
    scores, sheet = _scores(shown(pictures), references, triangles=len(scene), seconds=seconds)
    return scores | {"beside": {name: _scores(shown(x), references)[0] for name, x in beside.items()}}, sheet


def without_network(encoded: EncodedScene, view: View, guides: Guides) -> np.ndarray:
    """(H, W, 3) radiance of what the guided network adds to: traced light and a share of the radiosity."""
    frame, context = encoded.normalization, encoded.encoded
    config = encoded.renderer.pipeline.network.config
    with torch.inference_mode():
        inputs = guided_view(context.scene, frame.view(view), frame.guides(guides), context.prior, context.radiosity,
                             config)
        raw = torch.zeros(1, len(OUTPUTS), view.height, view.width)
        return (decode_image(raw, inputs.guides)[0] / frame.exposure).permute(1, 2, 0).numpy()


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
    return min(read_pass(path, "Combined").items())[1]


def _scores(pictures: list[np.ndarray], references: list[np.ndarray], **more) -> tuple[dict[str, float], np.ndarray]:
    pairs = list(zip(pictures, references, strict=True))
    views = [compare(a, b) for a, b in pairs]
    mean = {key: float(np.mean([v[key] for v in views])) for key in views[0]}
    rows = [np.concatenate([linear_to_srgb(a), linear_to_srgb(b)], axis=1) for a, b in pairs]
    return mean | {key: round(value, 3) for key, value in more.items()}, np.concatenate(rows, axis=0)


def _mean(scores: list[dict]) -> dict:
    """Of every figure that all scenes have, and the worst PSNR; of what they are set beside likewise."""
    mean = {key: float(np.mean([s[key] for s in scores])) for key in METRICS}
    mean["worst_psnr"] = min(s["psnr"] for s in scores)
    names = set.intersection(*(set(s.get("beside", {})) for s in scores))
    return mean | {name: _mean([s["beside"][name] for s in scores]) for name in sorted(names)}


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
    report = {"weights": options.weights, "scenes": scenes, "mean": _mean(list(scenes.values()))}
    (options.output / "report.json").write_text(json.dumps(report, indent=1))
    print(json.dumps(report))
    return 0


if __name__ == "__main__":
    sys.exit(main())
