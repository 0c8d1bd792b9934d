# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.evaluate.oracles SAMPLE_DIR: what the network could add to estimated light, if it knew the answer.

SAMPLE_DIR holds samples of `python -m tools.datagen`. With traced light and without, the picture that the network adds
to is mended in ways that look at the reference: by a factor of all bounced light of the scene, by one for each lobe, by
a smooth one for each place, by Cycles' own bounced diffuse light, and by the smoothed difference. Prints one JSON
object: PSNR, mean and of the worst scene. A way that gains little is none that is worth learning.
"""
from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from skimage.filters import gaussian

from renderformer_v2.model.color import linear_to_srgb
from renderformer_v2.model.metrics.scores import psnr
from renderformer_v2.model.renderer import EncodedScene, Renderer
from renderformer_v2.model.scene import Guides, View
from renderformer_v2.model.weights.presets import BUNDLED
from tools.datagen.sample_files import load_sample, sample_paths

from .samples import estimated_light, world_radiance

FACTORS = np.geomspace(0.25, 4.0, 33)
ROUNDS = 4
PLACE = 6.0   # pixels, sigma of a smooth factor
NEAR = 4.0    # pixels, sigma of the smoothed difference
ALIKE = 0.2   # sigma in normals and diffuse colours of pixels that are smoothed together


@dataclass
class Shown:
    """One view: linear (H, W, 3) pictures."""

    rest: np.ndarray        # all but the light that has bounced
    bounced: np.ndarray     # (3, H, W, 3), of each lobe, times its colour
    diffuse: np.ndarray     # of the reference: bounced diffuse light times its colour
    reference: np.ndarray
    alike: np.ndarray       # (H, W, 6) normals and diffuse colours

    def picture(self, factors=(1.0, 1.0, 1.0)) -> np.ndarray:
        return self.rest + np.tensordot(np.asarray(factors), self.bounced, 1)

    def psnr(self, picture: np.ndarray) -> float:
        return psnr(linear_to_srgb(picture), linear_to_srgb(self.reference))


def per_scene(views: list[Shown]) -> float:
    return _best(views, [(f,) * 3 for f in FACTORS])[0]


def per_lobe(views: list[Shown]) -> float:
    """One factor after the other, ROUNDS times, from that of the scene on."""
    best, factors = _best(views, [(f,) * 3 for f in FACTORS])
    for lobe in (0, 1, 2) * ROUNDS:
        best, factors = _best(views, [(*factors[:lobe], f, *factors[lobe + 1:]) for f in FACTORS])
    return best


def _best(views: list[Shown], tried: list[tuple[float, ...]]) -> tuple[float, tuple[float, ...]]:
    """The factors of the lobes that mend best, and how well."""
    return max((_mean(views, lambda view, factors=factors: view.picture(factors)), factors) for factors in tried)


def per_place(views: list[Shown]) -> float:
    def mended(view: Shown) -> np.ndarray:
        bounced = view.bounced.sum(0)
        smooth = lambda x: gaussian(x.mean(-1), PLACE)  # noqa: E731
        factor = smooth(view.reference - view.rest) / np.maximum(smooth(bounced), 1e-9)
        return view.rest + bounced * factor.clip(FACTORS[0], FACTORS[-1])[..., None]

    return _mean(views, mended)


def cycles_diffuse(views: list[Shown]) -> float:
    return _mean(views, lambda v: v.picture((0.0, 1.0, 1.0)) + v.diffuse)


def smoothed_difference(views: list[Shown]) -> float:
    return _mean(views, lambda v: v.picture() + _bilateral(v.reference - v.picture(), v.alike))


ORACLES = {"without_network": lambda views: _mean(views, Shown.picture), "factor_per_scene": per_scene,
           "factor_per_lobe": per_lobe, "factor_per_place": per_place, "cycles_diffuse": cycles_diffuse,
           "smoothed_difference": smoothed_difference}


def _mean(views: list[Shown], mended: Callable[[Shown], np.ndarray]) -> float:
    return float(np.mean([view.psnr(mended(view)) for view in views]))


def _bilateral(picture: np.ndarray, alike: np.ndarray) -> np.ndarray:
    """(H, W, 3) smoothed among pixels that are `alike` (H, W, C)."""
    reach = int(2 * NEAR)
    padded = [np.pad(x, ((reach,) * 2, (reach,) * 2, (0, 0)), mode="edge") for x in (picture, alike)]
    h, w = picture.shape[:2]
    total, weights = np.zeros_like(picture), np.zeros((h, w, 1), picture.dtype)
    for y, x in np.ndindex(2 * reach + 1, 2 * reach + 1):
        there, other = (p[y:y + h, x:x + w] for p in padded)
        apart = ((y - reach) ** 2 + (x - reach) ** 2) / NEAR ** 2
        weight = np.exp(-(apart + ((other - alike) ** 2).sum(-1, keepdims=True) / ALIKE ** 2) / 2)
        total += weight * there
        weights += weight
    return total / weights


def shown(encoded: EncodedScene, view: View, guides: Guides, passes: dict[str, np.ndarray]) -> Shown:
    """What the network adds to, in world radiance."""
    light = estimated_light(encoded, view, guides)
    radiance, indirect = (world_radiance(encoded, x) for x in (light.radiance(), light.indirect()))
    bounced = indirect * np.stack([guides.diffuse_color, guides.glossy_color, guides.transmission_color])
    seen = guides.emission + guides.environment
    return Shown(radiance + seen - bounced.sum(0), bounced, passes["diffuse_indirect"] * guides.diffuse_color,
                 passes["combined"][..., :3] + passes["environment"],
                 np.dstack([guides.normal, guides.diffuse_color]).astype(np.float32))


def study(paths: list[Path], renderer: Renderer) -> dict[str, dict[str, dict[str, float]]]:
    """By setting and oracle the mean PSNR of the scenes and that of the worst one."""
    found: dict[str, dict[str, list[float]]] = {}
    for path in paths:
        scene, views, guides, passes = load_sample(path)
        encoded = renderer.encode(scene)
        for setting in ("traced_hints", "network_alone"):
            if setting == "network_alone":
                guides = [replace(guide, traced=None) for guide in guides]
            seen = [shown(encoded, *known) for known in zip(views, guides, passes, strict=True)]
            for name, oracle in ORACLES.items():
                found.setdefault(setting, {}).setdefault(name, []).append(oracle(seen))
        print(path.stem, {s: {k: round(v[-1], 1) for k, v in f.items()} for s, f in found.items()}, file=sys.stderr)
    return {setting: {name: {"psnr": float(np.mean(values)), "worst_psnr": min(values)}
                      for name, values in oracles.items()} for setting, oracles in found.items()}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.evaluate.oracles", description=__doc__)
    parser.add_argument("samples", type=Path, metavar="SAMPLE_DIR")
    parser.add_argument("--limit", type=int, help="only the first LIMIT scenes")
    options = parser.parse_args()
    paths = sample_paths(options.samples)[: options.limit]
    if not paths:
        print(f"no samples in {options.samples}: make some with python -m tools.datagen", file=sys.stderr)
        return 2
    print(json.dumps(study(paths, Renderer(BUNDLED, device="cpu", precision="fp32")), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
