# SPDX-License-Identifier: GPL-3.0-or-later
"""The way of the bundled network from scenes to pictures (model/pipeline.py): estimated light, transformer, kernels."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..compute.inference import current_pieces
from ..compute.threads import undivided_operations
from ..light.bounce.radiosity import Radiosity
from ..light.direct.direct_light import DirectLight
from ..light.effort import DRAFT, FULL, Effort
from ..light.estimate import SceneLight, estimate_light
from ..light.surface_light import SurfaceLight
from ..light_passes import Lobes
from ..material.mappers import load_material_mapper
from ..network.layers import store_in_precision
from ..network.renderformer import SceneContext
from ..pictures import BAND_PIXELS, bands
from ..progress import part, steps
from ..scene import Guides, RenderScene, View
from ..weights.presets import weights_folder
from .decoding import OUTPUTS, corrected_light
from .features import guided_view, with_exposure
from .guided_inputs import guided_inputs
from .kernels import antialiased
from .network import load_network
from .reduced_view import reduction_of


@dataclass
class GuidedScene:
    """A scene's light, and its tokens after stage 1 where light is not estimated by rays."""

    light: SceneLight
    context: SceneContext | None = None
    is_draft: bool = False

    @property
    def tokens(self) -> int:
        """Length of the sequence."""
        return 0 if self.context is None else len(self.context.tokens)


class GuidedPipeline:
    """One network for every resolution."""

    def __init__(self, weights: str | Path, device: torch.device, dtype: torch.dtype, rays: bool = True):
        """rays: whether light is estimated by rays; else the network's only estimate is unshadowed direct light."""
        self.network = store_in_precision(load_network(weights_folder(weights)), dtype).to(device).eval()
        self.device, self.config, self.granularity = device, self.network.config, self.network.config.granularity
        self.rays, self.mapper = rays, None if rays else load_material_mapper()

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
            return GuidedScene(self._light(scene, direct, DRAFT), is_draft=True)

    def finished(self, draft: GuidedScene) -> GuidedScene:
        return self._encoded(draft.light.scene, draft.light.direct)

    def _encoded(self, scene: RenderScene, direct: DirectLight) -> GuidedScene:
        if self.rays:
            with part(0.05, 1.0, "Estimating bounced light"):
                return GuidedScene(self._light(scene, direct))
        with part(0.05, 1.0):
            inputs = guided_inputs(scene, self.config, self.mapper, direct).to(self.device)
            return GuidedScene(self._light(scene, direct), self.network.encode_scene(inputs))

    @undivided_operations()
    def _light(self, scene: RenderScene, direct: DirectLight, effort: Effort = FULL) -> SceneLight:
        return SceneLight(scene, direct, Radiosity(scene, direct, effort) if self.rays else None)

    def image(self, encoded: GuidedScene, view: View, guides: Guides, effort: Effort = FULL) -> Tensor:
        return self.lobes(encoded, view, guides, apart=False, effort=effort)["radiance"]

    def lobes(self, encoded: GuidedScene, view: View, guides: Guides, apart: bool = True,
              effort: Effort = FULL) -> dict[str, Tensor]:
        """Pictures by field of Lobes, in network exposure; `direct` and `indirect` only if `apart`."""
        is_traced = guides.traced is not None
        if encoded.is_draft or not effort.network:
            with part(0.0, 0.95, "Estimating direct light"):
                light = estimate_light(encoded.light, view, guides, effort, apart or not is_traced)
            with part(0.95, 1.0, "Adding the light up"):
                return _in_bands(light.rows, view, is_traced, apart)
        with part(0.0, 0.6, "Estimating direct light"):
            inputs = guided_view(encoded.light, view, guides, self.config, effort)
        with part(0.6, 0.95):
            raw = self.network.render_view(encoded.context, inputs, reduction_of(view.longer_side))
        with part(0.95, 1.0, "Adding the light up"):

            def light(rows: slice) -> SurfaceLight:
                return with_exposure(corrected_light(raw[..., rows, :], inputs.rows(rows)), 1 / inputs.exposure)

            return _in_bands(light, view, is_traced, apart) | {"latent": raw[0, OUTPUTS["latent"]]}

    def antialiased(self, pictures: dict[str, np.ndarray], lobes: Lobes, guides: Guides,
                    wraps: bool = False) -> dict[str, np.ndarray]:
        """As the function of that name."""
        return antialiased(self.network.kernel_predictor, pictures, lobes, guides, wraps)


def _in_bands(light: Callable[[slice], SurfaceLight], view: View, is_traced: bool, apart: bool) -> dict[str, Tensor]:
    """Pictures by field of Lobes, of one view; `light` gives that of some rows, so that sums need bounded memory."""
    parts = []
    for rows, _ in steps(bands(view.height, view.width, margin=0, pixels=current_pieces().limit(BAND_PIXELS))):
        some = light(rows)
        parts.append({"radiance": some.radiance()[0]})
        if is_traced:
            parts[-1]["traced"] = some.traced[0]
        if apart:
            parts[-1] |= {"direct": some.direct[0], "indirect": some.indirect()[0]}
    return {name: torch.cat([part[name] for part in parts], dim=-2) for name in parts[0]}
