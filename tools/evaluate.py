# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.evaluate SCENE_DIR -o REPORT_DIR: how close the engine is to Cycles on held-out scenes.

SCENE_DIR holds samples of `python -m tools.datagen` (the RenderScene that the engine makes, and Cycles references).
Prints one JSON object with PSNR, SSIM and FLIP per scene and their means; REPORT_DIR gets the same as report.json and
one PNG per scene: each view's picture, then its reference.
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

from model.renderer import Renderer
from tools.datagen.shards import load_sample, sample_paths
from tools.metrics import compare, srgb


def evaluate_sample(path: Path, renderer: Renderer) -> tuple[dict[str, float], np.ndarray]:
    """Mean metrics over the views of one sample, and its contact sheet (H, W, 3) in [0, 1]."""
    scene, views, guides, passes = load_sample(path)
    scores, rows = [], []
    begin = time.perf_counter()
    for view, guide, reference in zip(views, guides, passes):
        picture = renderer.render(scene, view, guide) + guide.emission + guide.environment
        target = reference["combined"][..., :3] + guide.environment
        scores.append(compare(picture, target))
        rows.append(np.concatenate([srgb(picture), srgb(target)], axis=1))
    mean = {key: float(np.mean([s[key] for s in scores])) for key in scores[0]}
    mean |= {"triangles": len(scene), "seconds": round(time.perf_counter() - begin, 3)}
    return mean, np.concatenate(rows, axis=0)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.evaluate", description=__doc__)
    parser.add_argument("scenes", type=Path, metavar="SCENE_DIR")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="REPORT_DIR")
    parser.add_argument("--weights", default="small", help="'small' or a folder")
    parser.add_argument("--limit", type=int, help="only the first LIMIT samples")
    options = parser.parse_args()
    paths = sample_paths(options.scenes)[: options.limit]
    if not paths:
        print(f"no samples in {options.scenes}: make some with python -m tools.datagen", file=sys.stderr)
        return 2
    from skimage.io import imsave

    options.output.mkdir(parents=True, exist_ok=True)
    renderer = Renderer(options.weights)
    scenes = {}
    for path in paths:
        scenes[path.stem], sheet = evaluate_sample(path, renderer)
        imsave(options.output / f"{path.stem}.png", (sheet * 255 + 0.5).astype(np.uint8), check_contrast=False)
    mean = {key: float(np.mean([s[key] for s in scenes.values()])) for key in ("psnr", "ssim", "flip")}
    report = {"weights": options.weights, "scenes": scenes, "mean": mean}
    (options.output / "report.json").write_text(json.dumps(report, indent=1))
    print(json.dumps(report))
    return 0


if __name__ == "__main__":
    sys.exit(main())
