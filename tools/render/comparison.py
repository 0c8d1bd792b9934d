# SPDX-License-Identifier: GPL-3.0-or-later
"""Our picture and the Cycles reference of the same file: figures, and a sheet to look at."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from renderformer_v2.model.pictures import linear_to_srgb
from tools.common.metrics import AMPLIFIED, add_error_pictures, compare
from tools.common.pictures import read_pass, write_atomically

LEAST_WIDTH = 360   # pixels of a picture on the sheet: its title needs them
DPI = 100

Pair = tuple[np.ndarray, np.ndarray]  # ours, Cycles': (H, W, 3) f32, linear


def compare_layers(layers: list[dict], save: Callable[[Path], None], sheet: Path | None,
                   border: tuple[int, int, int, int] | None) -> None:
    """Give each view layer's statistics its "comparison": PSNR, SSIM and FLIP; write `sheet` unless it is None.

    save: writes the render result to a file. border: (x0, x1, y0, y1) from the bottom left, what was rendered of it;
    None for all. Raises RuntimeError when there is no reference, OSError naming `sheet`.
    """
    for layer in layers:
        if not layer["reference_samples"]:
            raise RuntimeError("there is no reference to compare with: " + "; ".join(layer["report"]))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "passes.exr"
        save(path)
        pairs = [tuple(_crop(border, read_pass(path, name, "RGB", layer["layer"]))
                       for name in ("Combined", "Cycles Reference")) for layer in layers]
    for layer, pair in zip(layers, pairs):
        layer["comparison"] = {name: round(value, 4) for name, value in compare(*pair).items()}
    if sheet:
        write_sheet(sheet, list(zip(pairs, layers)))


def _crop(border: tuple[int, int, int, int] | None, picture: np.ndarray) -> np.ndarray:
    if border is None:
        return picture
    left, right, bottom, top = border
    return picture[len(picture) - top:len(picture) - bottom, left:right]


def write_sheet(path: Path, rows: list[tuple[Pair, dict]]) -> None:
    """A PNG with ours, Cycles', their difference and FLIP in each row; a row is a pair and its statistics.

    The statistics are those of `tools.render` for one view layer, with "comparison".
    """
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot

    height, width = rows[0][0][0].shape[:2]
    scale = max(1.0, LEAST_WIDTH / width) / DPI
    figure, axes = pyplot.subplots(len(rows), 4, squeeze=False, layout="constrained", dpi=DPI,
                                   figsize=(4.4 * width * scale, len(rows) * (height * scale + 0.6)))
    for row, (pair, statistics) in zip(axes, rows):
        for axis, (title, picture) in zip(row, _title_pictures(pair, statistics)):
            axis.set_title(title, fontsize=10)
            axis.imshow(picture, interpolation="nearest")
            axis.set_axis_off()
    colors = pyplot.cm.ScalarMappable(pyplot.Normalize(0, 1), "magma")
    figure.colorbar(colors, ax=axes, label="FLIP", fraction=0.02, pad=0.005)
    try:
        write_atomically(path, figure.savefig)
    finally:
        pyplot.close(figure)


def _title_pictures(pair: Pair, statistics: dict) -> list[tuple[str, np.ndarray]]:
    pictures = add_error_pictures(dict(zip(("ours", "reference"), map(linear_to_srgb, pair), strict=True)))
    seconds, scores = statistics["seconds"], statistics["comparison"]
    own_seconds = sum(value for stage, value in seconds.items() if stage not in ("Cycles Reference", "total"))
    return [(f"RenderFormer-V2, {own_seconds:.1f} s", pictures["ours"]),
            (f"Cycles, {statistics['reference_samples']} samples, {seconds['Cycles Reference']:.1f} s",
             pictures["reference"]),
            (f"Difference x{AMPLIFIED}, PSNR {scores['psnr']:.1f} dB", pictures["difference"]),
            (f"FLIP {scores['flip']:.3f}, SSIM {scores['ssim']:.3f}", pictures["flip"])]
