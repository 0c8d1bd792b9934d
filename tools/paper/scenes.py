# SPDX-License-Identifier: GPL-3.0-or-later
"""The authors' scenes: ours beside Cycles, with the distances that the paper reports.

    python -m tools.paper scenes FRAME|FOLDER|SCENE.json ... -o DIR [--weights DIR] [--samples N] [--resolution N]
        [--tone-mapper M]

A FRAME is a prepared frame (a folder with scene_config.json); a FOLDER holds scenes as the authors' repository does
(NAME/frame/scene_config.json); SCENE.json is a scene of version 1. DIR gets a .blend file of each, both pictures, and
tone mapped PNGs. Pictures are compared without background, on black, as the network draws them.
"""
from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from renderformer_v2.model.published.prepared_frame import CONFIG
from renderformer_v2.model.weights.presets import BUNDLED, weights_folder
from tools.common.console import whole_number
from tools.common.markdown import write_table
from tools.common.metrics import compare
from tools.common.pictures import read_pass
from tools.common.render_process import run_render, run_render_cached
from tools.common.tone_mapping import STANDARD, TONE_MAPPERS
from tools.evaluate.scores import perceptual
from tools.extension import ROOT
from tools.h5.pictures import save_picture

# By scene: pixels and tone mapper of the authors' example, and tokens, PSNR, SSIM, LPIPS and FLIP in the paper
AUTHORS = {
    "transparent-torus": (512, STANDARD, (4481, 26.50, 0.9481, 0.0485, 0.1189)),
    "environment-lit-spheres": (512, STANDARD, (3009, 22.24, 0.9265, 0.0398, 0.1773)),
    "smoky-bunny": (512, STANDARD, (490, 36.51, 0.9861, 0.0373, 0.0825)),
    "three-teapots": (512, "pbr_neutral", (17653, 30.99, 0.9653, 0.0320, 0.1168)),
    "displacement-mapped-cornell-cube": (512, STANDARD, (5633, 30.97, 0.9297, 0.0319, 0.1845)),
    "spaceship-in-smoke": (2048, "agx", (36353, 27.05, 0.9633, 0.0648, 0.1605)),
    "dinner-scene": (2048, STANDARD, (29276, 24.34, 0.9171, 0.0712, 0.1992)),
    "cube-pile": (512, STANDARD, (3993, 26.41, 0.9243, 0.0474, 0.1031)),
    "dragon": (2048, "agx", None), "bedroom": (2048, "agx", None), "living-room": (2048, "agx", None),
    "living-room-daylight": (2048, STANDARD, None),
}
OTHER = 512, STANDARD, None
COLUMNS = {"psnr": "{:.2f}", "ssim": "{:.4f}", "lpips": "{:.4f}", "structure": "{:.4f}", "flip": "{:.4f}",
           "hdr_flip": "{:.4f}", "seconds": "{:.1f}"}


def main(arguments: list[str]) -> None:
    """Raises ValueError where there is no scene, RuntimeError with what an import or a render said."""
    parser = argparse.ArgumentParser(prog="python -m tools.paper scenes", description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--weights", default=BUNDLED)
    parser.add_argument("--samples", type=whole_number(1), default=512, help="of Cycles (the paper: 4096)")
    parser.add_argument("--resolution", type=whole_number(1), help="pixels (default: the authors')")
    parser.add_argument("--tone-mapper", choices=TONE_MAPPERS, help="of the PNG files (default: the authors')")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    table, text = {}, ""
    for name, source in list_scenes(options.scenes).items():
        table[name] = measure(name, source, options)
        text = write(table, options.output / "scenes")
    print(text, end="")


def list_scenes(paths: list[Path]) -> dict[str, Path]:
    """Frames and scene files by name. Raises ValueError for a path without any."""
    found = {}
    for path in paths:
        if path.suffix == ".json" or (path / CONFIG).is_file():
            configs = [path if path.suffix == ".json" else path / CONFIG]
        else:
            configs = sorted(path.glob(f"*/frame/{CONFIG}"))
        if not configs:
            raise ValueError(f"{path} holds no scene: choose a folder with {CONFIG}, or one of such folders")
        for config in configs:
            if config.name != CONFIG:
                found[config.stem] = config
            else:
                folder = config.parent
                found[folder.absolute().parent.name if folder.name == "frame" else folder.absolute().name] = folder
    return found


def measure(name: str, source: Path, options: argparse.Namespace) -> dict:
    """Import one scene, render it twice, and compare; what is there already is used."""
    size, mapper, _ = AUTHORS.get(name, OTHER)
    mapper = options.tone_mapper or mapper
    size, blend = options.resolution or size, options.output / f"{name}.blend"
    if not blend.exists():
        command = [sys.executable, "-m", "tools.import_scene", source.absolute(), "-o", blend.absolute(),
                   "--resolution", size]
        done = subprocess.run(list(map(str, command)), cwd=ROOT, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(done.stderr.strip())
    resolution = ["--resolution", f"{size}x{size}"]
    ours, cycles = (options.output / f"{name}_{engine}.exr" for engine in ("ours", "cycles"))
    ran = run_render(blend, ours, "--weights", weights_folder(options.weights).absolute(), *resolution)
    run_render_cached(blend, cycles, "--engine", "cycles", "--samples", options.samples, *resolution)
    a, b = (read_pass(path, "Combined", "RGB") for path in (ours, cycles))
    for path, picture in ((ours, a), (cycles, b)):
        save_picture(path.with_suffix(".png"), picture, mapper)
    return compare(a, b) | perceptual(a, b) | {
        "seconds": ran["seconds"]["total"], "tokens": ran["tokens"], "triangles": ran["triangles"],
        "report": ran["report"], "tone_mapper": mapper}


def write(table: dict[str, dict], path: Path) -> str:
    """The rows so far, as Markdown, and as files."""
    columns = {key: shown for key, shown in COLUMNS.items() if any(key in scores for scores in table.values())}
    head = ["scene", "tokens", *columns, "paper: tokens", "PSNR", "SSIM", "LPIPS", "FLIP"]
    rows = []
    for name, scores in table.items():
        paper = AUTHORS.get(name, OTHER)[2] or [""] * 5
        rows.append([name, str(scores["tokens"]), *(shown.format(scores[key]) if key in scores else ""
                                                    for key, shown in columns.items()), *map(str, paper)])
    return write_table(path, head, rows, table)
