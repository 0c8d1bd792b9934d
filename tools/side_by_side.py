# SPDX-License-Identifier: GPL-3.0-or-later
"""One picture of a scene four times: Transformer Alone, With Cycles, Cycles in the same time, Cycles with many samples.

    python -m tools.side_by_side SCENE.blend -o OUT.png [--samples 256] [--resolution WxH] [--weights rf2_small|DIR]
                                 [--threads N]

Labelled with the seconds that each render takes on this machine now, so leave it alone meanwhile. Prints them as one
line of JSON. Cycles renders as the file says, denoising included, but for the number of samples; in the third picture
they are as many as take nearest to the time of With Cycles.
"""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from tools.common.console import picture_size, whole_number
from tools.common.pictures import write_atomically
from tools.common.render_process import find_samples_in_time, run_render

GAP = 8        # pixels between the pictures
LINE = 2.2     # height of a label, in heights of its letters


def main() -> int:
    arguments = _parse_arguments()
    options = ["--resolution", "{}x{}".format(*arguments.resolution)] if arguments.resolution else []
    options += ["--threads", arguments.threads] if arguments.threads else []
    with tempfile.TemporaryDirectory() as folder:
        try:
            pictures, labels, seconds = render_all(arguments, Path(folder), options)
            arguments.output.parent.mkdir(parents=True, exist_ok=True)
            from skimage.io import imsave
            write_atomically(arguments.output.resolve(), lambda file: imsave(file, side_by_side(pictures, labels)))
        except (RuntimeError, OSError) as error:
            print(error, file=sys.stderr)
            return 1
    print(json.dumps(seconds | {"output": str(arguments.output)}))
    return 0


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.side_by_side", description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path, help=".blend file")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.png")
    parser.add_argument("--samples", type=whole_number(1), default=256, help="of the picture on the right")
    parser.add_argument("--resolution", type=picture_size, help="WxH in pixels (default: the file's)")
    parser.add_argument("--weights", help="rf2_small, or a folder with weights (default: the file's)")
    parser.add_argument("--threads", type=whole_number(1), help="processor threads (default: the file's)")
    arguments = parser.parse_args()
    if arguments.output.suffix.lower() != ".png":
        parser.error(f"{arguments.output}: the suffix must be .png")
    return arguments


def render_all(arguments: argparse.Namespace, folder: Path, options: list) -> tuple[list[np.ndarray], list[str], dict]:
    """The four pictures (H, W, 3) u8, what is written below them, and {picture: its samples and seconds}."""
    from skimage.io import imread

    def render_cycles(samples: int) -> float:
        statistics = run_render(arguments.scene, folder / f"{samples}.png", "--engine", "cycles", "--samples", samples,
                                *options)
        return statistics["seconds"]["total"]

    own = {}
    for light in ("TRANSFORMER", "TRACED"):
        statistics = run_render(arguments.scene, folder / f"{light}.png", "--light", light, *options,
                                *(["--weights", arguments.weights] if arguments.weights else []))
        own[light] = statistics["seconds"]["total"]
    seconds = own["TRACED"]
    equal, equal_seconds = find_samples_in_time(seconds, arguments.samples, render_cycles)
    many_seconds = render_cycles(arguments.samples)
    pictures = [imread(folder / f"{name}.png")[..., :3] for name in (*own, equal, arguments.samples)]
    labels = [f"Transformer Alone, {own['TRANSFORMER']:.1f} s", f"With Cycles, {seconds:.1f} s"] + [
        f"Cycles, {n} sample{'s' if n > 1 else ''}, {s:.1f} s"
        for n, s in ((equal, equal_seconds), (arguments.samples, many_seconds))]
    return pictures, labels, {"transformer_alone": {"seconds": own["TRANSFORMER"]},
                              "with_cycles": {"seconds": seconds},
                              "cycles_equal": {"samples": equal, "seconds": equal_seconds},
                              "cycles": {"samples": arguments.samples, "seconds": many_seconds}}


def side_by_side(pictures: list[np.ndarray], labels: list[str]) -> np.ndarray:
    """(H + label, W', 3) u8: pictures of one size, pixel by pixel as they are, each above its label."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height, width = pictures[0].shape[:2]
    letters = min(max(width / 30, 7), 20)
    size = len(pictures) * (width + GAP) - GAP, height + round(letters * LINE)
    figure = Figure(figsize=(size[0] / 72, size[1] / 72), dpi=72)  # a point is a pixel
    canvas = FigureCanvasAgg(figure)
    for i, label in enumerate(labels):
        figure.text((i * (width + GAP) + width / 2) / size[0], (size[1] - height) / 2 / size[1], label, ha="center",
                    va="center", fontsize=letters, color="black")
    canvas.draw()
    sheet = np.asarray(canvas.buffer_rgba())[..., :3].copy()
    for i, picture in enumerate(pictures):
        sheet[:height, i * (width + GAP):][:, :width] = picture
    return sheet


if __name__ == "__main__":
    sys.exit(main())
