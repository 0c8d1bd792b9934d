# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.evaluate.direct SCENE_DIR -o OUT_DIR: how close direct light of our own is to that of Cycles.

SCENE_DIR holds .blend files whose view layers have the passes of light, such as `examples/highlights.py` makes. Each is
rendered with Light > Network and Rays and by Cycles with --samples. Prints one JSON object: PSNR of the picture by
scene, and of each lobe's direct and indirect light times its colour. OUT_DIR keeps the renders, and uses those of
Cycles again.
"""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from renderformer_v2.model.metrics.scores import psnr
from renderformer_v2.model.pictures import linear_to_srgb
from tools.common.console import whole_number
from tools.common.pictures import read_pass
from tools.common.render_process import run_render, run_render_cached

# Pass names before and since Blender 5.0
LOBES = {"diffuse": ("Diff", "Diffuse "), "glossy": ("Gloss", "Glossy "), "transmission": ("Trans", "Transmission ")}
LIGHTS = {"direct": ("Dir", "Direct"), "indirect": ("Ind", "Indirect")}
COLORS = "Col", "Color"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.evaluate.direct", description=__doc__)
    parser.add_argument("scenes", type=Path, metavar="SCENE_DIR")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT_DIR")
    parser.add_argument("--samples", type=whole_number(1), default=1024, help="of Cycles")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="of scenes")
    options = parser.parse_args()
    paths = [path for path in sorted(options.scenes.glob("*.blend")) if path.stem in (options.only or [path.stem])]
    if not paths:
        print(f"no scenes in {options.scenes}: make some with examples/highlights.py", file=sys.stderr)
        return 2
    options.output.mkdir(parents=True, exist_ok=True)
    try:
        scores = {path.stem: compare_lobes(path, options.output, options.samples) for path in paths}
    except (KeyError, RuntimeError) as error:  # a pass is missing; what Blender says of a .blend file
        print(error.args[0], file=sys.stderr)
        return 1
    print(json.dumps(scores | {"mean": float(np.mean([score["picture"] for score in scores.values()]))}, indent=1))
    return 0


def compare_lobes(path: Path, folder: Path, samples: int) -> dict[str, float]:
    """PSNR of the picture and of the light of each lobe that is not black; `folder` gets the renders.

    Raises KeyError naming a pass that the file does not have, RuntimeError if it cannot be rendered.
    """
    ours, cycles = (folder / f"{path.stem}.{name}.exr" for name in ("alone", "cycles"))
    seconds = run_render(path, ours, "--light", "NETWORK")["seconds"]["total"]
    run_render_cached(path, cycles, "--engine", "cycles", "--samples", samples, "--unclamped")
    scores = {"seconds": seconds, "picture": _score(*(read_pass(exr, "Combined", "RGB") for exr in (ours, cycles)))}
    for lobe in LOBES:
        for light in LIGHTS:
            pictures = [_light_pass(exr, lobe, LIGHTS[light]) * _light_pass(exr, lobe, COLORS)
                        for exr in (ours, cycles)]
            if pictures[1].any():
                scores[f"{lobe}_{light}"] = _score(*pictures)
    return scores


def _light_pass(exr: Path, lobe: str, light: tuple[str, str]) -> np.ndarray:
    before, since_5 = (a + b for a, b in zip(LOBES[lobe], light, strict=True))
    try:
        return read_pass(exr, before, "RGB")
    except KeyError:
        return read_pass(exr, since_5, "RGB")


def _score(ours: np.ndarray, exact: np.ndarray) -> float:
    return round(psnr(linear_to_srgb(ours), linear_to_srgb(exact)), 2)


if __name__ == "__main__":
    sys.exit(main())
