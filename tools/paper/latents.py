# SPDX-License-Identifier: GPL-3.0-or-later
"""The space of material latents as a picture: random materials, by the two directions in which they differ most.

    python -m tools.paper latents -o DIR [--weights DIR] [--materials N]

The paper's figure is a t-SNE; this is a principal component analysis, which has no random start and no parameters.
Without --weights it is the latent space of the bundled mapper, which knows one shader; a published bundle has three.
"""
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch

from renderformer_v2.model.material.mappers import MAPPERS, load_material_mapper
from renderformer_v2.model.pictures import linear_to_srgb
from renderformer_v2.model.published.bundle import Bundle
from tools.common.console import whole_number
from tools.common.markdown import write_table

SHADERS = {  # by mapper: name, and whether each parameter is a colour (c), roughness (r), IOR (i) or another share (s)
    "diffspec_mapper": ("diffuse and specular", "cccsssr"), "metallic_mapper": ("metallic", "cccsr"),
    "metallic_transmission_mapper": ("metallic with transmission", "cccsris")}
MARKERS = dict(zip(SHADERS, "os^"))


def main(arguments: list[str]) -> None:
    """Raises CheckpointError for a bundle without mappers."""
    parser = argparse.ArgumentParser(prog="python -m tools.paper latents", description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--weights", type=Path, metavar="DIR", help="a published bundle (default: the bundled mapper)")
    parser.add_argument("--materials", type=whole_number(2), default=2000, help="of each shader (default: 2000)")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    if options.weights:
        mappers = {name: Bundle(options.weights).mapper(name) for name in MAPPERS}
    else:
        mappers = {"metallic_transmission_mapper": load_material_mapper()}
    random = np.random.default_rng(0)
    drawn = {name: draw_materials(SHADERS[name][1], options.materials, random) for name in mappers}
    with torch.inference_mode():
        latents = {name: mapper(torch.from_numpy(drawn[name])).numpy() for name, mapper in mappers.items()}
    places, shares = principal_components(np.concatenate(list(latents.values())))
    plot(drawn, dict(zip(latents, np.split(places[:, :2], len(latents)))), shares, options.output / "latents.png")
    print(write_table(options.output / "latents", ["component", "share of the variance"],
                      [[str(i), f"{100 * share:.1f} %"] for i, share in enumerate(shares, 1)],
                      {"shares": shares.tolist(), "shaders": [SHADERS[name][0] for name in mappers]}), end="")


def draw_materials(kinds: str, count: int, random: np.random.Generator) -> np.ndarray:
    """(count, len(kinds)) f32 parameters as the mappers were trained with (docs/scene-input.md 3.1)."""
    drawn = random.random((count, len(kinds)), np.float32)
    for i, kind in enumerate(kinds):
        if kind == "r":
            drawn[:, i] = 0.01 ** (1 - drawn[:, i])
        elif kind == "i":
            drawn[:, i] = 1 + 1.5 * drawn[:, i]
    return drawn


def principal_components(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, d) places along the axes of largest variance, and (d,) shares of the variance, the largest first."""
    centred = rows.astype(np.float64) - rows.mean(axis=0)
    _, singular, axes = np.linalg.svd(centred, full_matrices=False)
    return centred @ axes.T, singular ** 2 / (singular ** 2).sum()


def plot(drawn: dict[str, np.ndarray], places: dict[str, np.ndarray], shares: np.ndarray, path: Path) -> None:
    """Materials in their base (or diffuse) colour, the smoother the larger."""
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    figure, axis = pyplot.subplots(figsize=(7, 6), layout="constrained")
    for name, at in places.items():
        shader, kinds = SHADERS[name]
        roughness = drawn[name][:, kinds.index("r")]
        axis.scatter(*at.T, s=4 + 30 * (1 - roughness) ** 2, c=linear_to_srgb(drawn[name][:, :3]), marker=MARKERS[name],
                     linewidths=0, label=shader)
    axis.set(xlabel=f"first component ({100 * shares[0]:.0f} %)", ylabel=f"second component ({100 * shares[1]:.0f} %)")
    axis.legend(fontsize="small")
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
