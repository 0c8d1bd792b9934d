# SPDX-License-Identifier: GPL-3.0-or-later
"""Error by number of triangles: ours, and the same weights with full attention in place of the paper's RenderFormer V1.

    python -m tools.paper lpips-triangles -o DIR [--weights rf2_small|DIR] [--scene FILE.blend]
        [--triangles 4096,...] [--resolution N] [--samples N] [--light TRANSFORMER]

Without --scene it is that of tools.benchmark, which has as many triangles as are asked for.
"""
from __future__ import annotations

import argparse
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

from renderformer_v2.model.published.bundle import load_transformer
from renderformer_v2.model.published.bundle_files import TRANSFORMERS, is_bundle
from renderformer_v2.model.weights.presets import BUNDLED, weights_folder
from tools.benchmark import ring
from tools.common.console import numbers, whole_number
from tools.common.markdown import write_table
from tools.common.metrics import compare
from tools.common.pictures import read_pass
from tools.common.render_process import run_render, run_render_cached
from tools.common.scene_file import LIGHTS
from tools.evaluate.scores import perceptual, perceptual_column
from tools.train.published import copy_bundle, write_config

COUNTS = 4096, 8192, 16384, 32768, 65536, 131072
COLUMNS = {"psnr": "{:.2f}", "ssim": "{:.4f}", "lpips": "{:.4f}", "flip": "{:.4f}"}
PAPER = {  # triangles: PSNR, SSIM, LPIPS, FLIP of RF-V2, and of RF-V1
    4096: ((33.84, 0.9776, 0.0198, 0.1025), (34.51, 0.9823, 0.0244, 0.0838)),
    8192: ((33.00, 0.9682, 0.0305, 0.1230), (32.89, 0.9708, 0.0358, 0.1079)),
    16384: ((29.96, 0.9457, 0.0502, 0.1932), (29.36, 0.9418, 0.0604, 0.1555)),
    32768: ((28.07, 0.9205, 0.0729, 0.2387), (24.17, 0.8451, 0.1500, 0.3080)),
    65536: ((26.79, 0.9020, 0.0873, 0.2609), (18.72, 0.6651, 0.3070, 0.5313)),
    131072: ((25.82, 0.8847, 0.0999, 0.3220), (15.88, 0.4604, 0.4772, 0.7466)),
}


def main(arguments: list[str]) -> None:
    """Raises RuntimeError with what a render said."""
    parser = argparse.ArgumentParser(prog="python -m tools.paper lpips-triangles", description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--weights", default=BUNDLED)
    parser.add_argument("--scene", type=Path, metavar="FILE.blend")
    parser.add_argument("--triangles", type=numbers, default=COUNTS)
    parser.add_argument("--resolution", type=whole_number(1), default=512)
    parser.add_argument("--samples", type=whole_number(1), default=512, help="of Cycles")
    parser.add_argument("--light", choices=LIGHTS, default="TRANSFORMER", help="of the bundled network")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    own = weights_folder(options.weights).absolute()
    variants = {"ours": own, "full attention": full_attention(own, options.output / "full_attention")}
    table, text = {}, ""
    for count in options.triangles:
        table[count] = {name: measure(options, count, name, weights) for name, weights in variants.items()}
        text = write(table, options.output / "lpips-triangles")
    print(text, end="")


def measure(options: argparse.Namespace, count: int, name: str, weights: Path) -> dict[str, float]:
    """Distances of one picture from Cycles'; renders that are there already are used."""
    scene = options.scene or ring_file(count, options.output)
    size = ["--resolution", f"{options.resolution}x{options.resolution}"]
    reference, ours = options.output / f"{scene.stem}_cycles.exr", options.output / f"{count}_{name.split()[0]}.exr"
    run_render_cached(scene, reference, "--engine", "cycles", "--samples", options.samples, "--unclamped", *size)
    ran = run_render(scene, ours, "--weights", weights, "--light", options.light, "--triangles", count, *size)
    a, b = (read_pass(path, "Combined", "RGB") for path in (ours, reference))
    return compare(a, b) | perceptual(a, b) | {"triangles": ran["triangles"], "seconds": ran["seconds"]["total"]}


def ring_file(count: int, folder: Path) -> Path:
    """Save the benchmark's scene with that many triangles as a .blend file."""
    import bpy
    path = folder / f"ring_{count}.blend"
    if not path.exists():
        ring.build(count, 512)
        bpy.ops.wm.save_as_mainfile(filepath=str(path.absolute()))
    return path


def full_attention(weights: Path, folder: Path) -> Path:
    """The same weights, with a configuration in which all tokens of stage 1 see all."""
    if is_bundle(weights):
        copy_bundle(weights, folder)
        for name in filter(lambda name: (weights / name).is_dir(), TRANSFORMERS):
            write_config(folder / name, replace(load_transformer(weights / name).config, dense=True))
        return folder
    folder.mkdir(exist_ok=True)
    for file in weights.iterdir():
        if file.is_file() and not (folder / file.name).exists():
            try:
                os.link(file, folder / file.name)
            except OSError:  # another disk
                shutil.copyfile(file, folder / file.name)
    described = json.loads((weights / "config.json").read_text())
    described["model_config"]["dense"] = True
    (folder / "config.json").unlink()  # it may be a link
    (folder / "config.json").write_text(json.dumps(described, indent=1) + "\n")
    return folder


def write(table: dict[int, dict[str, dict[str, float]]], path: Path) -> str:
    """The rows so far, as Markdown, and as files."""
    distance, title = perceptual_column([scores for variants in table.values() for scores in variants.values()])
    head = ["triangles"]
    for name in next(iter(table.values())):
        head += [f"{name}: PSNR", "SSIM", title, "FLIP"]
    for name in ("RF-V2", "RF-V1"):
        head += [f"paper, {name}: PSNR", "SSIM", "LPIPS", "FLIP"]
    rows = []
    for count, variants in table.items():
        measured = [[shown.format(scores[distance if key == "lpips" else key]) for key, shown in COLUMNS.items()]
                    for scores in variants.values()]
        papers = [[shown.format(value) for shown, value in zip(COLUMNS.values(), values)]
                  for values in PAPER.get(count, ())] or [[""] * len(COLUMNS)] * 2
        rows.append([str(count), *sum(measured + papers, [])])
    return write_table(path, head, rows, table)
