# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.evaluate.oracles SAMPLE_DIR: what the network could add to estimated light, if it knew the answer.

SAMPLE_DIR holds samples of `python -m tools.datagen`. With traced light and without, the picture that the network adds
to is corrected in ways that look at the reference: by one factor for the indirect light of the scene, by one for each
lobe, by one that varies smoothly over the picture, by Cycles' own indirect diffuse light, and by the smoothed
difference. Prints one JSON object: PSNR, mean and of the worst scene. A correction that gains little is not worth
learning.
"""
from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from skimage.filters import gaussian

from renderformer_v2.model.metrics.scores import psnr
from renderformer_v2.model.pictures import linear_to_srgb
from renderformer_v2.model.renderer import EncodedScene, Renderer
from renderformer_v2.model.scene import Guides, View
from renderformer_v2.model.weights.presets import BUNDLED
from tools.datagen.sample_files import load_with_paths

from .samples import chosen_samples, estimated_light, world_radiance

FACTORS = np.geomspace(0.25, 4.0, 33)
ROUNDS = 4
SMOOTH = 6.0   # pixels, sigma of a smooth factor
NEAR = 4.0     # pixels, sigma of the smoothed difference
SIMILAR = 0.2  # sigma in normals and diffuse colours of pixels that are smoothed together


@dataclass
class CorrectableView:
    """One view: linear (H, W, 3) pictures."""

    rest: np.ndarray        # all but indirect light
    indirect: np.ndarray    # (3, H, W, 3), of each lobe, times its albedo
    diffuse: np.ndarray     # of the reference: indirect diffuse light times its albedo
    reference: np.ndarray
    surfaces: np.ndarray    # (H, W, 6) normals and diffuse albedos

    def picture(self, factors=(1.0, 1.0, 1.0)) -> np.ndarray:
        return self.rest + np.tensordot(np.asarray(factors), self.indirect, 1)

    def psnr(self, picture: np.ndarray) -> float:
        return psnr(linear_to_srgb(picture), linear_to_srgb(self.reference))


def scale_scene(views: list[CorrectableView]) -> float:
    return _find_best(views, [(f,) * 3 for f in FACTORS])[0]


def scale_lobes(views: list[CorrectableView]) -> float:
    """One factor after the other, ROUNDS times, from that of the scene on."""
    best, factors = _find_best(views, [(f,) * 3 for f in FACTORS])
    for lobe in (0, 1, 2) * ROUNDS:
        best, factors = _find_best(views, [(*factors[:lobe], f, *factors[lobe + 1:]) for f in FACTORS])
    return best


def _find_best(views: list[CorrectableView], candidates: list[tuple[float, ...]]) -> tuple[float, tuple[float, ...]]:
    """The best PSNR, and the factors of the lobes that reach it."""
    return max((_mean_psnr(views, lambda view, factors=factors: view.picture(factors)), factors)
               for factors in candidates)


def scale_smoothly(views: list[CorrectableView]) -> float:
    def correct(view: CorrectableView) -> np.ndarray:
        indirect = view.indirect.sum(0)
        smooth = lambda x: gaussian(x.mean(-1), SMOOTH)  # noqa: E731
        factor = smooth(view.reference - view.rest) / np.maximum(smooth(indirect), 1e-9)
        return view.rest + indirect * factor.clip(FACTORS[0], FACTORS[-1])[..., None]

    return _mean_psnr(views, correct)


def use_reference_diffuse(views: list[CorrectableView]) -> float:
    return _mean_psnr(views, lambda v: v.picture((0.0, 1.0, 1.0)) + v.diffuse)


def add_smoothed_difference(views: list[CorrectableView]) -> float:
    return _mean_psnr(views, lambda v: v.picture() + _smooth(v.reference - v.picture(), v.surfaces))


ORACLES = {"without_network": lambda views: _mean_psnr(views, CorrectableView.picture), "factor_per_scene": scale_scene,
           "factor_per_lobe": scale_lobes, "factor_per_place": scale_smoothly, "cycles_diffuse": use_reference_diffuse,
           "smoothed_difference": add_smoothed_difference}


def _mean_psnr(views: list[CorrectableView], correct: Callable[[CorrectableView], np.ndarray]) -> float:
    return float(np.mean([view.psnr(correct(view)) for view in views]))


def _smooth(picture: np.ndarray, surfaces: np.ndarray) -> np.ndarray:
    """(H, W, 3) smoothed among pixels with similar `surfaces` (H, W, C)."""
    reach = int(2 * NEAR)
    padded = [np.pad(x, ((reach,) * 2, (reach,) * 2, (0, 0)), mode="edge") for x in (picture, surfaces)]
    h, w = picture.shape[:2]
    total, weights = np.zeros_like(picture), np.zeros((h, w, 1), picture.dtype)
    for y, x in np.ndindex(2 * reach + 1, 2 * reach + 1):
        neighbour, surface = (p[y:y + h, x:x + w] for p in padded)
        distance = ((y - reach) ** 2 + (x - reach) ** 2) / NEAR ** 2
        weight = np.exp(-(distance + ((surface - surfaces) ** 2).sum(-1, keepdims=True) / SIMILAR ** 2) / 2)
        total += weight * neighbour
        weights += weight
    return total / weights


def prepare_view(encoded: EncodedScene, view: View, guides: Guides, passes: dict[str, np.ndarray]) -> CorrectableView:
    """What the network adds to, in world radiance."""
    light = estimated_light(encoded, view, guides)
    radiance, indirect = (world_radiance(encoded, x) for x in (light.radiance(), light.indirect()))
    indirect = indirect * np.stack([guides.diffuse_color, guides.glossy_albedo, guides.transmission_color])
    directly_visible = guides.emission + guides.environment
    return CorrectableView(
        rest=radiance + directly_visible - indirect.sum(0), indirect=indirect,
        diffuse=passes["diffuse_indirect"] * guides.diffuse_color,
        reference=passes["combined"][..., :3] + passes["environment"],
        surfaces=np.dstack([guides.normal, guides.diffuse_color]).astype(np.float32))


def study(paths: list[Path], renderer: Renderer) -> dict[str, dict[str, dict[str, float]]]:
    """The mean PSNR of the scenes and that of the worst one, by setting and oracle."""
    results: dict[str, dict[str, list[float]]] = {}
    for path in paths:
        scene, views, guides, passes = load_with_paths(path)
        encoded = renderer.encode(scene)
        for setting in ("traced_hints", "network_and_rays"):
            if setting == "network_and_rays":
                guides = [replace(guide, traced=None) for guide in guides]
            prepared = [prepare_view(encoded, *row) for row in zip(views, guides, passes, strict=True)]
            for name, oracle in ORACLES.items():
                results.setdefault(setting, {}).setdefault(name, []).append(oracle(prepared))
        print(path.stem, {s: {k: round(v[-1], 1) for k, v in f.items()} for s, f in results.items()}, file=sys.stderr)
    return {setting: {name: {"psnr": float(np.mean(values)), "worst_psnr": min(values)}
                      for name, values in oracles.items()} for setting, oracles in results.items()}


def main() -> int:
    paths = chosen_samples("python -m tools.evaluate.oracles", __doc__)
    if not paths:
        return 2
    print(json.dumps(study(paths, Renderer(BUNDLED, device="cpu", precision="fp32")), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
