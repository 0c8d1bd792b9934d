# SPDX-License-Identifier: GPL-3.0-or-later
"""The way of the bundled network from scenes to pictures (model/pipeline.py): estimated light, transformer, kernels."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..compute.inference import current_pieces
from ..light.bounce.radiosity import Radiosity
from ..light.direct.direct_light import DirectLight
from ..light.effort import DRAFT, FULL, Effort
from ..light.estimate import SceneLight, estimate_light
from ..light.surface_light import SurfaceLight
from ..material.mappers import load_material_mapper
from ..network.layers import store_in_precision
from ..network.renderformer import SceneContext
from ..pictures import BAND_PIXELS, bands
from ..progress import part
from ..scene import Guides, RenderScene, View
from ..weights.presets import weights_folder
from .decoding import corrected_light
from .features import guided_view, with_exposure
from .guided_inputs import guided_inputs
from .kernels import antialiased
from .network import GuidedRenderFormer, load_network


@dataclass
class GuidedScene:
    """A scene's light, and its tokens after stage 1 where there is a transformer and this is no draft."""

    light: SceneLight
    context: SceneContext | None = None
    tokens: int = 0  # length of the sequence


class GuidedPipeline:
    """One network for every resolution. Without a transformer the picture is estimated and traced light as it is."""

    def __init__(self, weights: str | Path, device: torch.device, dtype: torch.dtype):
        network = store_in_precision(load_network(weights_folder(weights)), dtype).to(device).eval()
        self.device, self.config, self.granularity = device, network.config, network.config.granularity
        self.kernel_predictor = network.kernel_predictor
        self.transformer = network if isinstance(network, GuidedRenderFormer) else None
        self.mapper = load_material_mapper() if self.transformer else None

    def variant(self, picture_size: int) -> str:
        return ""

    def prepare(self, scene: RenderScene) -> None:
        """Nothing is shared between scenes."""

    def encode(self, scene: RenderScene, variant: str) -> GuidedScene:
        with part(0.0, 0.05, "Estimating direct light"):
            direct = DirectLight(scene, self.device)
        return self._encoded(scene, direct)

    def draft(self, scene: RenderScene, variant: str) -> GuidedScene:
        """The scene without stage 1: its pictures show the estimated light, by fewer rays."""
        with part(0.0, 0.5, "Estimating direct light"):
            direct = DirectLight(scene, self.device)
        with part(0.5, 1.0, "Estimating bounced light"):
            return GuidedScene(SceneLight(scene, direct, Radiosity(scene, direct, DRAFT)))

    def finished(self, draft: GuidedScene) -> GuidedScene:
        return self._encoded(draft.light.scene, draft.light.direct)

    def _encoded(self, scene: RenderScene, direct: DirectLight) -> GuidedScene:
        with part(0.05, 0.1 if self.transformer else 1.0, "Estimating bounced light"):
            light = SceneLight(scene, direct, Radiosity(scene, direct))
        if self.transformer is None:
            return GuidedScene(light)
        with part(0.1, 1.0):
            inputs = guided_inputs(scene, self.config, self.mapper).to(self.device)
            context = self.transformer.encode_scene(inputs)
        return GuidedScene(light, context, len(context.tokens))

    def image(self, encoded: GuidedScene, view: View, guides: Guides, effort: Effort = FULL) -> Tensor:
        return self.lobes(encoded, view, guides, apart=False, effort=effort)["radiance"]

    def lobes(self, encoded: GuidedScene, view: View, guides: Guides, apart: bool = True,
              effort: Effort = FULL) -> dict[str, Tensor]:
        """Pictures by field of Lobes, in network exposure; `direct` and `indirect` only if `apart`."""
        with_direct = guides.traced is None or apart
        if encoded.context is None:
            with part(0.0, 0.95, "Estimating direct light"):
                light = estimate_light(encoded.light, view, guides, effort, with_direct)
        else:
            light = self._corrected(encoded, view, guides, effort)
        with part(0.95, 1.0, "Adding the light up"):
            pictures = _in_bands(light, apart)
        traced = {} if guides.traced is None else {"traced": light.traced[0]}
        return pictures | traced | ({"direct": light.direct[0]} if apart else {})

    def _corrected(self, encoded: GuidedScene, view: View, guides: Guides, effort: Effort) -> SurfaceLight:
        """The light of a view after the transformer, in network exposure."""
        with part(0.0, 0.1, "Estimating direct light"):
            inputs = guided_view(encoded.light, view, guides, self.config, effort)
        with part(0.1, 0.95):
            raw = self.transformer.render_view(encoded.context, inputs)
            return with_exposure(corrected_light(raw, inputs), 1 / inputs.exposure)

    def antialiased(self, pictures: dict[str, np.ndarray], radiance: np.ndarray, guides: Guides,
                    samples: np.ndarray | int, wraps: bool = False) -> dict[str, np.ndarray]:
        """As the function of that name."""
        return antialiased(self.kernel_predictor, pictures, radiance, guides, samples, wraps)


def _in_bands(light: SurfaceLight, apart: bool) -> dict[str, Tensor]:
    """Radiance (3, H, W), and if `apart` indirect light (3, 3, H, W), of one view; the sums need bounded memory."""
    height, width = light.roughness.shape[-2:]
    parts = []
    for rows, _ in bands(height, width, margin=0, pixels=current_pieces().limit(BAND_PIXELS)):
        some = light.rows(rows)
        parts.append({"radiance": some.radiance()[0]} | ({"indirect": some.indirect()[0]} if apart else {}))
    return {name: torch.cat([part[name] for part in parts], dim=-2) for name in parts[0]}
