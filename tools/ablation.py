# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's ablation of sparse attention, in small: python -m tools.ablation --data DIR --held-out DIR --out DIR.

Trains the bundled network with each row's attention from the same weights for the same --steps, on samples of
tools.datagen, in Transformer Alone; then renders held-out samples, prints a table beside the paper's numbers, and
writes it and its numbers (.json) into OUT. The learning rate falls until the last step. The same command goes on where
it was stopped; more --steps continue all rows, at the rate that they would have then.
"""
from __future__ import annotations

import argparse
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from renderformer_v2.model.errors import CheckpointError
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.weights.presets import BUNDLED, weights_folder
from tools.common.console import whole_number
from tools.common.markdown import write_table
from tools.common.metrics import compare
from tools.datagen.sample_files import load_with_paths, sample_paths
from tools.evaluate.samples import read_references
from tools.evaluate.scores import perceptual, perceptual_column
from tools.extension import ROOT

SINKLESS = {"sinks": False, "light_sinks": False, "summaries": False}
ROWS = {  # settings of ModelConfig; PSNR, SSIM, LPIPS and HDR-FLIP of the paper's table
    "full": ({}, (28.25, 0.8982, 0.0997, 0.4200)),
    "w/o AS": (SINKLESS, (27.36, 0.8841, 0.1247, 0.4359)),
    "w/o SW": ({"local_attention_window_size_half": 0}, (26.92, 0.8715, 0.1289, 0.4517)),
    "AS w/o L": ({"light_sinks": False}, (27.40, 0.8813, 0.1081, 0.4250)),
    "AS w/o S": ({"summaries": False}, (27.09, 0.8754, 0.1210, 0.4485)),
    "AS w/o L, S": ({"light_sinks": False, "summaries": False}, (26.13, 0.8474, 0.1514, 0.4959)),
    "more S (#seq / 32)": ({"summary_block_size": 32}, (27.78, 0.8923, 0.1072, 0.4231)),
    "less S (#seq / 128)": ({"summary_block_size": 128}, (26.48, 0.8690, 0.1346, 0.4655)),
    "less S (#seq / 256)": ({"summary_block_size": 256}, (26.93, 0.8663, 0.1316, 0.4580)),
    "full attention": ({"dense": True}, (27.91, 0.8953, 0.1027, 0.4287)),
}
CONFIG = Path(__file__).with_name("train") / "ablation.json"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.ablation", description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="samples to train on")
    parser.add_argument("--held-out", type=Path, required=True, help="samples to compare with")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--start", default=BUNDLED, help="weights that all rows begin with (default: the bundled ones)")
    parser.add_argument("--steps", type=whole_number(1), default=1000)
    parser.add_argument("--config", type=Path, default=CONFIG, help="of the training, whose network is changed")
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=list(ROWS), metavar="ROW", help=", ".join(ROWS))
    options = parser.parse_args(arguments)
    paths = sample_paths(options.held_out)
    if not paths:
        print(f"no samples in {options.held_out}: make some with python -m tools.datagen", file=sys.stderr)
        return 2
    table, text = {}, ""
    for name in options.rows:
        try:
            weights = train(name, options)
            table[name] = evaluate(weights, paths, options.steps)
        except (CheckpointError, RuntimeError) as error:
            print(f"{name}: {error}", file=sys.stderr)
            return 1
        text = write(table, options.out / "ablation")
    print(text, end="")
    return 0


def train(name: str, options: argparse.Namespace) -> Path:
    """Go on with one row until its --steps are done; the folder of its weights. Raises RuntimeError if that fails."""
    folder = options.out / "".join(letter if letter.isalnum() else "_" for letter in name)
    folder.mkdir(parents=True, exist_ok=True)
    config = json.loads(options.config.read_text())
    config["network"] = config.get("network", {}) | ROWS[name][0]
    config["cosine_steps"] = max(options.steps - config["warmup_steps"], 1)  # or the last steps' noise hides the row
    for stage in config["stages"]:
        stage["scene"] = 1.0  # Transformer Alone
    (folder / "config.json").write_text(json.dumps(config, indent=1))
    command = ["tools.train.network", "--data", options.data, "--out", folder, "--config", folder / "config.json",
               "--start", weights_folder(options.start), "--steps", options.steps]
    print(f"{name}: {options.steps} steps", file=sys.stderr, flush=True)
    done = subprocess.run([sys.executable, "-m", *map(str, command)], cwd=ROOT, stdout=subprocess.DEVNULL,
                          stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr.strip() or f"tools.train.network ended with {done.returncode}")
    return folder / "weights"


def evaluate(weights: Path, paths: list[Path], steps: int) -> dict[str, float]:
    """Means over all views of the samples, kept beside the weights. Raises CheckpointError."""
    note, made_of = weights / "scores.json", {"steps": steps, "samples": [path.name for path in paths]}
    kept = json.loads(note.read_text()) if note.exists() else {}
    if kept.get("made_of") == made_of:
        return kept["scores"]
    renderer, views = Renderer(weights, rays=False), []
    for path in paths:
        scene, cameras, guides, passes = load_with_paths(path)
        encoded = renderer.encode(scene)
        for view, guide, reference in zip(cameras, guides, read_references(passes), strict=True):
            picture = encoded.picture(view, replace(guide, traced=None))
            views.append(compare(picture, reference) | perceptual(picture, reference))
    scores = {name: float(np.mean([view[name] for view in views])) for name in views[0]}
    note.write_text(json.dumps({"made_of": made_of, "scores": scores}))
    return scores


def write(table: dict[str, dict[str, float]], path: Path) -> str:
    """The rows so far, as Markdown, and as files."""
    distance, title = perceptual_column(list(table.values()))
    columns = {"psnr": "{:.2f}", "ssim": "{:.4f}", distance: "{:.4f}", "hdr_flip": "{:.4f}"}
    head = ["", "PSNR", "SSIM", title, "HDR-FLIP", "paper: PSNR", "SSIM", "LPIPS", "HDR-FLIP"]
    rows = [[name, *(shown.format(scores[key]) for key, shown in columns.items()),
             *(shown.format(value) for shown, value in zip(columns.values(), ROWS[name][1]))]
            for name, scores in table.items()]
    return write_table(path, head, rows, table)


if __name__ == "__main__":
    sys.exit(main())
