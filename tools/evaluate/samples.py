# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of tools.datagen: the network's picture of what is stored, beside what it is made from."""
from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from renderformer_v2.model.guided.decoding import OUTPUTS, decode_bands
from renderformer_v2.model.guided.guided_inputs import guided_view
from renderformer_v2.model.guided.pipeline import GuidedContext
from renderformer_v2.model.renderer import EncodedScene, Renderer
from renderformer_v2.model.scene import Guides, View
from tools.datagen.sample_files import hint_samples, load_sample

from .scores import Evaluation, scores


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
    if isinstance(encoded.encoded, GuidedContext) and guides[0].traced is not None:
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
    found = scores(ours, references, triangles=len(scene), seconds=seconds)
    found["beside"] = {name: scores(shown, references) for name, shown in beside.items()}
    columns = {"ours": ours, "reference": references} | (
        {"equal": beside["cycles_equal"]} if "cycles_equal" in beside else {})
    return Evaluation(found, [dict(zip(columns, row)) for row in zip(*columns.values())])


def _picture(encoded: EncodedScene, view: View, guides: Guides, hints: int) -> np.ndarray:
    """(H, W, 3) on an opaque film; hints: samples that the guides are made of."""
    if not isinstance(encoded.encoded, GuidedContext):
        return encoded.view(view, guides) + guides.emission + guides.environment
    lobes = encoded.lobes(view, guides, apart=False)
    whole = {"whole": lobes.radiance + guides.emission + guides.environment}
    return encoded.antialiased(whole, lobes, guides, hints)["whole"]


def without_network(encoded: EncodedScene, view: View, guides: Guides) -> np.ndarray:
    """(H, W, 3) radiance of what the guided network adds to: traced light, or the light prior, and the radiosity."""
    return prior_light(encoded, view, guides, ("image",))["image"]


def prior_light(encoded: EncodedScene, view: View, guides: Guides, keys: Sequence[str]) -> dict[str, np.ndarray]:
    """The `keys` of `decode_light` without the network, (..., H, W, 3) world radiance; no `direct` of traced light."""
    frame, context = encoded.normalization, encoded.encoded
    config = encoded.renderer.pipeline.network.config
    with torch.inference_mode():
        inputs = guided_view(context.scene, frame.view(view), frame.guides(guides), context.prior, context.radiosity,
                             config, direct=guides.traced is None)
        light = decode_bands(torch.zeros(1, len(OUTPUTS), view.height, view.width), inputs.guides, keys)
        exposure = frame.exposure * inputs.guides.exposure
        return {key: (radiance[0] / exposure).movedim(-3, -1).numpy() for key, radiance in light.items()}
