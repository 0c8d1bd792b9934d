# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of tools.datagen: the network's picture of what is stored, beside what it is made from."""
from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from renderformer_v2.model.guided.pipeline import GuidedScene
from renderformer_v2.model.light.estimate import estimate_light
from renderformer_v2.model.light.surface_light import SurfaceLight
from renderformer_v2.model.renderer import EncodedScene, Renderer
from renderformer_v2.model.scene import Guides, View
from tools.datagen.sample_files import hint_samples, load_sample

from .scores import Evaluation, compute_scores


def evaluate_sample(path: Path, renderer: Renderer) -> Evaluation:
    """Mean metrics over the views of one sample, and of what it is set beside."""
    scene, views, guides, passes = load_sample(path)
    begin = time.perf_counter()
    encoded = renderer.encode(scene)
    seen = list(zip(views, guides, strict=True))
    hints = hint_samples(path)
    ours = [_picture(encoded, view, guide, hints) for view, guide in seen]
    seconds = time.perf_counter() - begin
    beside = {}
    if isinstance(encoded.encoded, GuidedScene) and guides[0].traced is not None:
        beside["traced_alone"] = [guide.traced for guide in guides]
        beside["without_network"] = [without_network(encoded, view, guide) for view, guide in seen]
        untraced = [(view, replace(guide, traced=None)) for view, guide in seen]
        beside["priors_alone"] = [without_network(encoded, view, guide) for view, guide in untraced]
    if "equal" in passes[0]:
        beside["cycles_equal"] = [p["equal"][..., :3] - guide.emission for p, guide in zip(passes, guides, strict=True)]

    def shown(surfaces: list[np.ndarray]) -> list[np.ndarray]:
        return [a + guide.emission + guide.environment for a, guide in zip(surfaces, guides, strict=True)]

    beside = {name: shown(surfaces) for name, surfaces in beside.items()}
    if "priors_alone" in beside:
        beside["network_alone"] = [_picture(encoded, view, guide, hints) for view, guide in untraced]
    references = [p["combined"][..., :3] + p["environment"] for p in passes]
    found = compute_scores(ours, references, triangles=len(scene), seconds=seconds)
    found["beside"] = {name: compute_scores(shown, references) for name, shown in beside.items()}
    columns = {"ours": ours, "reference": references} | (
        {"equal": beside["cycles_equal"]} if "cycles_equal" in beside else {})
    return Evaluation(found, [dict(zip(columns, row)) for row in zip(*columns.values())])


def _picture(encoded: EncodedScene, view: View, guides: Guides, hints: int) -> np.ndarray:
    """(H, W, 3) on an opaque film; hints: samples that the guides are made of."""
    if not isinstance(encoded.encoded, GuidedScene):
        return encoded.view(view, guides) + guides.emission + guides.environment
    lobes = encoded.lobes(view, guides, apart=False)
    whole = {"whole": lobes.radiance + guides.emission + guides.environment}
    return encoded.antialiased(whole, lobes, guides, hints)["whole"]


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
