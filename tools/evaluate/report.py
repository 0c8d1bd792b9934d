# SPDX-License-Identifier: GPL-3.0-or-later
"""report.html and its pictures: all scenes on one page, which needs nothing but the files beside it."""
from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from renderformer_v2.model.pictures import linear_to_srgb
from tools.common.metrics import AMPLIFIED, add_error_pictures
from tools.common.pictures import to_bytes

from .scores import Evaluation

TITLES = {  # of pictures
    "ours": "RenderFormer-V2",
    "reference": "Cycles, reference",
    "equal": "Cycles, equal time",
    "difference": f"difference × {AMPLIFIED}",
    "flip": "FLIP",
}
TEMPLATE = Path(__file__).with_name("page.html")
OURS = "RenderFormer-V2"
MAGMA_STOPS = 17  # of the gradient below the FLIP map
BESIDE = {  # keys of a scene's "beside", in the order of the page
    "without_network": "without the network",
    "network_and_rays": "network and rays",
    "rays_alone": "rays alone",
    "transformer_alone": "transformer alone",
    "traced_alone": "traced light alone",
    "cycles_equal": "Cycles, equal time",
    "grey": "a grey picture",
}
CYCLES = "cycles_"  # and a number of samples: keys beside these
COLUMNS = {  # of the table: keys of a scene
    "psnr": ("PSNR", "dB", "{:.2f}"),
    "ssim": ("SSIM", "", "{:.4f}"),
    "flip": ("FLIP", "", "{:.4f}"),
    "hdr_flip": ("HDR-FLIP", "", "{:.4f}"),
    "seconds": ("time", "s", "{:.2f}"),
    "cycles_seconds": ("Cycles reference", "s", "{:.2f}"),
    "triangles": ("triangles", "", "{:.0f}"),
}


class Picture(NamedTuple):
    kind: str  # a key of TITLES
    file: str  # relative to the report
    width: int
    height: int


def write_page(report: dict, pictures: dict[str, list[list[Picture]]], path: Path) -> None:
    """Write the page of a report (report.json), with the pictures of each view by scene."""
    from jinja2 import Environment

    compact = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)  # no line is left where a block was
    template = compact.from_string(TEMPLATE.read_text("utf-8"))
    scenes, mean = report["scenes"], report["mean"]
    columns = {key: column for key, column in COLUMNS.items() if any(key in s for s in scenes.values())}
    keys = {key for scene in scenes.values() for key in scene.get("beside", {})}
    beside = {key: title for key, title in BESIDE.items() if key in keys} | {
        key: f"Cycles, {key.removeprefix(CYCLES)} samples" for key in sorted(keys - set(BESIDE), key=_count_samples)}
    worst = min(scenes, key=lambda name: scenes[name]["psnr"])
    path.write_text(template.render(
        weights=report["weights"], scenes=scenes, mean=mean, worst=worst, columns=columns, beside=beside, ours=OURS,
        pictures=pictures, titles=TITLES, amplified=AMPLIFIED, magma=_magma()), "utf-8")


def write_pictures(evaluation: Evaluation, report: Path, scene: str) -> list[list[Picture]]:
    """Write PNGs below `report`, sRGB-encoded and clipped to [0, 1]; those of each view, in the order of TITLES."""
    from skimage.io import imsave

    folder = Path("pictures") / scene
    (report / folder).mkdir(parents=True, exist_ok=True)
    rows = []
    for index, view in enumerate(evaluation.views, 1):
        pixels = add_error_pictures({kind: linear_to_srgb(linear) for kind, linear in view.items()})
        row = []
        for kind in sorted(pixels, key=list(TITLES).index):
            file = folder / f"{index}-{kind}.png"
            imsave(report / file, to_bytes(pixels[kind]), check_contrast=False)
            row.append(Picture(kind, file.as_posix(), pixels[kind].shape[1], pixels[kind].shape[0]))
        rows.append(row)
    return rows


def _count_samples(key: str) -> int:
    return int(key.removeprefix(CYCLES))


def _magma() -> str:
    """The colours of the FLIP map from 0 to 1, as the stops of a CSS gradient."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return ", ".join(to_hex(colormaps["magma"](i / (MAGMA_STOPS - 1))) for i in range(MAGMA_STOPS))
