# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.finetune FILE.blend [FILE.blend ...] --out DIR: fine-tune a network on your own scenes.

Renders samples of the files with Cycles into DIR/samples (tools.datagen --blend), then trains on all that are there.
--start says from which weights: the bundled kernels (a transformer learns from nothing beside them), a folder that
tools.train.network wrote, or a published bundle; DIR/weights or DIR/bundle is then ready for `python -m tools.render
SCENE.blend -o OUT.exr --weights`. The same command again goes on where it was stopped; the files and the weights at the
start are never changed.
"""
from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from renderformer_v2.model.published.bundle_files import is_bundle
from renderformer_v2.model.weights.presets import BUNDLED, PRESETS, weights_folder
from tools.common.console import whole_number
from tools.extension import ROOT

COOLDOWN = 0.25  # of the minutes
SIDE = PRESETS[BUNDLED]().granularity


def main() -> int:
    options = _parse_arguments()
    start = weights_folder(options.start).resolve()
    published = is_bundle(start)
    if not published and not (start / "model.safetensors").is_file():
        print(f"--start {options.start}: there are no weights in {start}: choose {BUNDLED}, a folder that "
              "tools.train.network wrote, or a published bundle", file=sys.stderr)
        return 2
    resolution = options.resolution or (256 if published else 128)
    if not published and resolution % SIDE:
        print(f"--resolution {resolution}: this network is trained with multiples of {SIDE} pixels", file=sys.stderr)
        return 2
    out = options.out.resolve()
    data, threads = out / "samples", ["--threads", options.threads]
    status = _run("tools.datagen", data, "--blend", *(file.resolve() for file in options.files), "--views",
                  options.views, "--resolution", resolution, "--samples", options.samples, *threads)
    if status:
        return status
    training = ["tools.train.published"] if published else [
        "tools.train.network", "--cache", out / "cache", "--wait", 0]
    config = options.config or Path(__file__).with_name("published.json" if published else "finetune.json")
    device = ["--device", options.device] if options.device else []
    status = _run(*training, "--data", data, "--start", start, "--out", out, "--config", config.resolve(),
                  "--minutes", options.minutes, "--cooldown", COOLDOWN * options.minutes, *threads, *device)
    if not status:
        print(f"python -m tools.render SCENE.blend -o OUT.exr --weights {out / ('bundle' if published else 'weights')}")
    return status


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.train.finetune", description=__doc__)
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE.blend")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--start", default=BUNDLED, help=f"{BUNDLED} (default), WEIGHTS_DIR or BUNDLE_DIR")
    parser.add_argument("--minutes", type=float, default=60.0, help="of training (default 60)")
    parser.add_argument("--views", type=whole_number(1), default=8, help="of each file (default 8)")
    parser.add_argument("--resolution", type=whole_number(1), help="pixels (default 128, of a published bundle 256)")
    parser.add_argument("--samples", type=whole_number(1), default=64, help="of Cycles, before OpenImageDenoise")
    parser.add_argument("--config", type=Path, help="how to train (default finetune.json or published.json here)")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="processor threads (default: all)")
    parser.add_argument("--device", help="of PyTorch (default: cuda where it is, else cpu)")
    return parser.parse_args()


def _run(*command: object) -> int:
    """Exit status of `python -m` with these words, in the repository's root."""
    return subprocess.run([sys.executable, "-m", *map(str, command)], cwd=ROOT).returncode


if __name__ == "__main__":
    sys.exit(main())
