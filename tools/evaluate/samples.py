# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of tools.datagen: the network's pictures, and those of estimated and traced light beside them."""
from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.light.estimate import estimate_light
from renderformer_v2.model.light.surface_light import SurfaceLight
from renderformer_v2.model.pipeline import LobePipeline
from renderformer_v2.model.renderer import EncodedScene, Renderer
from renderformer_v2.model.scene import Guides, View
from tools.datagen.sample_files import load_with_paths, sample_paths

from .scores import Evaluation, compute_scores


class Renderers(NamedTuple):
    """One network twice: with estimates by rays, and for the scene alone."""

    rays: Renderer
    scene: Renderer | None  # None for the published network, whose input is always the scene alone

    @classmethod
    def of(cls, weights: str) -> Renderers:
        rays = Renderer(weights)
        return cls(rays, Renderer(weights, rays=False) if isinstance(rays.pipeline, LobePipeline) else None)


def chosen_samples(program: str, description: str) -> list[Path]:
    """The samples that a command line SAMPLE_DIR [--limit N] names; none, and a word about it, if there are none."""
    parser = argparse.ArgumentParser(prog=program, description=description)
    parser.add_argument("samples", type=Path, metavar="SAMPLE_DIR")
    parser.add_argument("--limit", type=int, help="only the first LIMIT scenes")
    options = parser.parse_args()
    paths = sample_paths(options.samples)[: options.limit]
    if not paths:
        print(f"no samples in {options.samples}: make some with python -m tools.datagen", file=sys.stderr)
    return paths


def evaluate_sample(path: Path, renderers: Renderers) -> Evaluation:
    """Mean metrics over the views of one sample, and of the pictures "beside" ours."""
    scene, views, guides, passes = load_with_paths(path)
    references = read_references(passes)

    def encode(renderer: Renderer) -> tuple[EncodedScene, float]:
        begin = time.perf_counter()
        return renderer.encode(scene), time.perf_counter() - begin

    def score(encoded: EncodedScene, encoding: float, guides: list[Guides], **more) -> tuple[dict, list[np.ndarray]]:
        begin = time.perf_counter()
        pictures = [encoded.picture(view, guide) for view, guide in zip(views, guides, strict=True)]
        seconds = encoding + time.perf_counter() - begin
        return compute_scores(pictures, references, seconds=seconds, **more), pictures

    encoded, seconds = encode(renderers.rays)
    scores, ours = score(encoded, seconds, guides, triangles=len(scene))
    beside = {}
    if renderers.scene and guides[0].traced is not None:
        untraced = [replace(guide, traced=None) for guide in guides]
        beside["network_and_rays"], _ = score(encoded, seconds, untraced)
        beside["transformer_alone"], _ = score(*encode(renderers.scene), untraced)
        surfaces = {"traced_alone": [guide.traced for guide in guides],
                    "without_network": [without_network(encoded, *pair) for pair in zip(views, guides)],
                    "rays_alone": [without_network(encoded, *pair) for pair in zip(views, untraced)]}
        beside |= {name: compute_scores(_complete(light, guides), references) for name, light in surfaces.items()}
    columns = {"ours": ours, "reference": references}
    if "equal" in passes[0]:
        columns["equal"] = _complete([p["equal"][..., :3] - guide.emission
                                       for p, guide in zip(passes, guides, strict=True)], guides)
        beside["cycles_equal"] = compute_scores(columns["equal"], references)
    scores["beside"] = beside
    return Evaluation(scores, [dict(zip(columns, row)) for row in zip(*columns.values())])


def read_references(passes: list[dict[str, np.ndarray]]) -> list[np.ndarray]:
    """Cycles' pictures (H, W, 3) on an opaque film, by the passes of each view."""
    return [p["combined"][..., :3] + p["environment"] for p in passes]


def _complete(surfaces: list[np.ndarray], guides: list[Guides]) -> list[np.ndarray]:
    """Radiance of surfaces with the emitters and the world that are seen directly."""
    return [surface + guide.emission + guide.environment for surface, guide in zip(surfaces, guides, strict=True)]


def without_network(encoded: EncodedScene, view: View, guides: Guides) -> np.ndarray:
    """(H, W, 3) world radiance of the light that the guided network corrects."""
    return world_radiance(encoded, estimated_light(encoded, view, guides).radiance())


def estimated_light(encoded: EncodedScene, view: View, guides: Guides) -> SurfaceLight:
    """The light that the guided network corrects, in network exposure; no direct light where light was traced."""
    frame = encoded.normalization
    with inference():
        return estimate_light(encoded.encoded.light, frame.view(view), frame.guides(guides),
                              with_direct=guides.traced is None)


def world_radiance(encoded: EncodedScene, light: torch.Tensor) -> np.ndarray:
    """(1, ..., 3, H, W) radiance in network exposure -> (..., H, W, 3)."""
    return (light[0] / encoded.normalization.exposure).movedim(-3, -1).cpu().numpy()
