# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.evaluate.lobes SAMPLE_DIR: how much light of each lobe is estimated, as a ratio to that of Cycles.

SAMPLE_DIR holds samples of `python -m tools.datagen`. Without traced light, the estimates of *Network and Rays* are
added up over all pixels of a view that show one kind of material, and so is the light of Cycles' passes, whose noise
this averages. Prints a table: by lobe and kind of material the median ratio, and those of the tenth and ninetieth of a
hundred. What is far from 1 is wrong in a way that no picture needs to be looked at for.
"""
from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from renderformer_v2.model.light.specular.glass import CLEAR, LEAST_CLEAR, PURE
from renderformer_v2.model.light_passes import LOBES
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.scene import METALLIC, ROUGHNESS, TRANSMISSION, Guides, RenderScene
from renderformer_v2.model.weights.presets import BUNDLED
from tools.datagen.sample_files import load_with_paths

from .samples import chosen_samples, estimated_light, world_radiance

STEPS = 10                             # of a parameter from 0 to 1: pixels that round to the same are one material
LEAST_PIXELS, LEAST_SHARE = 60, 0.1    # of a material in a view, and of its light that a lobe has to be worth a ratio
ROUGHNESSES = 0.0, 0.1, 0.25, 0.45, 0.65
PASSES = {"diffuse direct": ("diffuse_direct",), "diffuse indirect": ("diffuse_indirect",),
          "glossy direct": ("glossy_direct",), "glossy indirect": ("glossy_indirect",),
          "transmission": ("transmission_direct", "transmission_indirect")}  # the sky in glass is indirect in Cycles

Ratios = dict[tuple[str, str, float], list[float]]  # by lobe, kind of material, and roughness from which on


def collect_ratios(paths: list[Path], renderer: Renderer) -> Ratios:
    ratios: Ratios = defaultdict(list)
    for path in paths:
        scene, views, guides, passes = load_with_paths(path)
        encoded = renderer.encode(scene)
        for view, guide, own in zip(views, guides, passes, strict=True):
            light = estimated_light(encoded, view, replace(guide, traced=None))
            ours = {f"{lobe}_{kind}": radiance
                    for kind, lobes in (("direct", light.direct), ("indirect", light.indirect()))
                    for lobe, radiance in zip(LOBES, world_radiance(encoded, lobes))}
            albedo = dict(zip(LOBES, (guide.diffuse_color, guide.glossy_albedo, guide.transmission_color)))
            for kind, roughness, pixels in materials(scene, guide):
                shown = own["combined"][pixels][:, :3].mean()
                for name, keys in PASSES.items():
                    estimated, exact = (sum((light[key] * albedo[key.split("_")[0]])[pixels].mean() for key in keys)
                                        for light in (ours, own))
                    if exact > LEAST_SHARE * shown:
                        ratios[name, kind, roughness].append(float(estimated / exact))
    return ratios


def materials(scene: RenderScene, guides: Guides) -> Iterator[tuple[str, float, np.ndarray]]:
    """Kind, the roughness of its class, and (H, W) bool pixels of each material of a view."""
    middle = scene.tiles.shape[-1] // 2
    tile = scene.tiles[scene.seen_tile[guides.hit_triangle.clip(0)], :, middle, middle].astype(np.float32)
    parameters = tile[..., [TRANSMISSION, METALLIC, ROUGHNESS]]
    rounded = np.rint(STEPS * parameters)
    covered = (guides.hit_triangle >= 0) & (guides.alpha > 0.99)
    for values in np.unique(rounded[covered], axis=0):
        pixels = covered & (rounded == values).all(-1)
        if pixels.sum() >= LEAST_PIXELS:
            transmission, metallic, roughness = parameters[pixels].mean(0)
            kind = ("metal" if metallic > PURE else "glass" if transmission > CLEAR
                    else "partly glass" if transmission > LEAST_CLEAR else "matte or glossy")
            yield kind, max(least for least in ROUGHNESSES if least <= roughness), pixels


def table(ratios: Ratios) -> str:
    """The ratios as a table in Markdown."""
    lines = ["| lobe | material | roughness | views | median | 10 % | 90 % |", "|---|---|---:|---:|---:|---:|---:|"]
    for (lobe, kind, roughness), values in sorted(ratios.items()):
        shown = (f"{value:.2f}" for value in np.percentile(values, (50, 10, 90)))
        lines.append(f"| {lobe} | {kind} | {roughness} | {len(values)} | {' | '.join(shown)} |")
    return "\n".join(lines)


def main() -> int:
    paths = chosen_samples("python -m tools.evaluate.lobes", __doc__)
    if not paths:
        return 2
    print(table(collect_ratios(paths, Renderer(BUNDLED, device="cpu", precision="fp32"))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
