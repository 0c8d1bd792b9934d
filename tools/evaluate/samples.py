# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of tools.datagen: the network's pictures, and those of estimated and traced light beside them."""
from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.guided.pipeline import GuidedScene
from renderformer_v2.model.light.estimate import estimate_light
from renderformer_v2.model.light.surface_light import SurfaceLight
from renderformer_v2.model.renderer import EncodedScene, Renderer
from renderformer_v2.model.scene import Guides, View
from tools.datagen.sample_files import hint_samples, load_with_paths

from .scores import Evaluation, compute_scores


def evaluate_sample(path: Path, renderer: Renderer) -> Evaluation:
    """Mean metrics over the views of one sample, and of the pictures "beside" ours."""
    scene, views, guides, passes = load_with_paths(path)
    begin = time.perf_counter()
    encoded = renderer.encode(scene)
    hints = hint_samples(path)
    ours = [_render(encoded, view, guide, hints) for view, guide in zip(views, guides, strict=True)]
    seconds = time.perf_counter() - begin
    surfaces, network_alone = {}, {}  # radiance without directly seen emitters and world
    if isinstance(encoded.encoded, GuidedScene) and guides[0].traced is not None:
        untraced = [replace(guide, traced=None) for guide in guides]
        surfaces["traced_alone"] = [guide.traced for guide in guides]
        surfaces["without_network"] = [without_network(encoded, *pair) for pair in zip(views, guides)]
        surfaces["priors_alone"] = [without_network(encoded, *pair) for pair in zip(views, untraced)]
        network_alone["network_alone"] = [_render(encoded, *pair, hints) for pair in zip(views, untraced)]
    if "equal" in passes[0]:
        surfaces["cycles_equal"] = [p["equal"][..., :3] - guide.emission
                                    for p, guide in zip(passes, guides, strict=True)]
    beside = {name: [surface + guide.emission + guide.environment
                     for surface, guide in zip(of_views, guides, strict=True)] for name, of_views in surfaces.items()}
    beside |= network_alone
    references = [p["combined"][..., :3] + p["environment"] for p in passes]
    scores = compute_scores(ours, references, triangles=len(scene), seconds=seconds)
    scores["beside"] = {name: compute_scores(pictures, references) for name, pictures in beside.items()}
    columns = {"ours": ours, "reference": references} | (
        {"equal": beside["cycles_equal"]} if "cycles_equal" in beside else {})
    return Evaluation(scores, [dict(zip(columns, row)) for row in zip(*columns.values())])


def _render(encoded: EncodedScene, view: View, guides: Guides, hints: int) -> np.ndarray:
    """(H, W, 3) on an opaque film; hints: samples that the guides are made of."""
    if not isinstance(encoded.encoded, GuidedScene):
        return encoded.view(view, guides) + guides.emission + guides.environment
    lobes = encoded.lobes(view, guides, apart=False)
    picture = {"picture": lobes.radiance + guides.emission + guides.environment}
    return encoded.antialiased(picture, lobes, guides, hints)["picture"]


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
