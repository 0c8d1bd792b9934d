# SPDX-License-Identifier: GPL-3.0-or-later
"""The guided network as the renderer uses it: guides and light prior in, light per lobe out (docs/architecture.md)."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from ..light.bounce.radiosity import Radiosity
from ..light.direct.direct_light import DirectLight
from ..light.effort import DRAFT, FULL, Effort
from ..material.mappers import load_material_mapper
from ..network.layers import in_precision
from ..network.renderformer import SceneContext
from ..progress import part
from ..scene import Guides, RenderScene, View
from ..weights.presets import weights_folder
from .antialiasing import antialiased
from .decoding import OUTPUTS, decode_bands
from .guided_inputs import guided_inputs, guided_view
from .network import load_network


@dataclass
class GuidedContext:
    """A scene after stage 1, with what guides a view of it."""

    scene: RenderScene
    context: SceneContext | None  # None: a draft, or of a network that adds nothing
    prior: DirectLight
    radiosity: Radiosity
    tokens: int


class GuidedPipeline:
    """One network for every resolution (see model/renderer.py for what a pipeline is)."""

    def __init__(self, weights: str | Path, device: torch.device, dtype: torch.dtype):
        self.network = in_precision(load_network(weights_folder(weights)), dtype).to(device).eval()
        self.device, self.mapper = device, load_material_mapper()
        self.granularity, self.is_idle = self.network.config.granularity, self.network.is_idle

    def variant(self, picture_size: int) -> str:
        return ""

    def encode(self, scene: RenderScene, variant: str) -> GuidedContext:
        with part(0.0, 0.05, "Estimating direct light"):
            prior = DirectLight(scene, self.device)
        return self.finished(GuidedContext(scene, None, prior, None, self._tokens(scene)))

    def draft(self, scene: RenderScene, variant: str) -> GuidedContext:
        """The scene without stage 1: pictures of it show the light of the priors, by fewer rays."""
        with part(0.0, 0.5, "Estimating direct light"):
            prior = DirectLight(scene, self.device)
        with part(0.5, 1.0, "Estimating bounced light"):
            return GuidedContext(scene, None, prior, Radiosity(scene, prior, DRAFT), self._tokens(scene))

    def finished(self, draft: GuidedContext) -> GuidedContext:
        with part(0.05, 1.0 if self.is_idle else 0.1, "Estimating bounced light"):
            radiosity = Radiosity(draft.scene, draft.prior)
        if self.is_idle:
            return replace(draft, radiosity=radiosity)
        with part(0.1, 1.0):
            inputs = guided_inputs(draft.scene, self.network.config, self.mapper).to(self.device)
            return replace(draft, context=self.network.encode_scene(inputs), radiosity=radiosity)

    def _tokens(self, scene: RenderScene) -> int:
        lights = int(scene.is_light.sum())
        return self.network.config.sequence_length(lights, len(scene) - lights + len(scene.volumes or ()))

    def image(self, encoded: GuidedContext, view: View, guides: Guides, effort: Effort = FULL) -> torch.Tensor:
        return self.light(encoded, view, guides, ("image",), effort)["image"]

    def light(self, encoded: GuidedContext, view: View, guides: Guides, keys: Sequence[str],
              effort: Effort = FULL) -> dict[str, torch.Tensor]:
        """The `keys` of `decode_light` without its first axis, in network exposure; `image` as above."""
        known = 0.1 if encoded.context else 0.95
        direct = not self.is_idle or guides.traced is None or "direct" in keys
        with part(0.0, known, "Estimating direct light"):
            inputs = guided_view(encoded.scene, view, guides, encoded.prior, encoded.radiosity,
                                 self.network.config, effort, direct)
        with part(known, 0.95):
            raw = (self.network.render_view(encoded.context, inputs) if encoded.context else
                   inputs.origin.new_zeros(()).expand(1, len(OUTPUTS), view.height, view.width))
        with part(0.95, 1.0, "Adding the light up"):
            light = decode_bands(raw, inputs.guides, keys)
            return {key: radiance[0] / inputs.guides.exposure for key, radiance in light.items()}

    def antialiased(self, pictures: dict[str, np.ndarray], radiance: np.ndarray, guides: Guides, samples: int,
                    wraps: bool = False) -> dict[str, np.ndarray]:
        """As the function of that name."""
        return antialiased(self.network.kernel_predictor, pictures, radiance, guides, samples, wraps)
