# SPDX-License-Identifier: GPL-3.0-or-later
"""The guided preset: guides and light prior in, light per lobe out (design.md, "The guided small preset")."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch

from ..camera import view_rays
from ..checkpoint import load_small
from ..network.renderformer import SceneContext
from ..precision import in_precision
from ..scene import Guides, RenderScene, View
from ..scene_inputs import material_tiles, pooled_tiles, small_inputs
from .guidance import decode_image, encode_guided, view_guided
from .guides import guide_tensors
from .light_prior import LightPrior


@dataclass
class EncodedScene:
    scene: RenderScene
    context: SceneContext
    prior: LightPrior


class GuidedPipeline:
    """One network for every resolution."""

    def __init__(self, weights: str | Path, device: torch.device, dtype: torch.dtype):
        model, self.mapper = load_small(weights)
        self.device, self.model = device, in_precision(model, dtype).to(device).eval()

    def variant(self, view: View) -> str:
        return ""

    def encode(self, scene: RenderScene, variant: str, progress) -> EncodedScene:
        inputs = small_inputs(scene, material_tiles(pooled_tiles(scene.tiles), self.mapper)).to(self.device)
        lights = inputs.is_light.cpu().numpy()  # the very faint ones, which are none for the network, left out
        beams = (torch.as_tensor(x[lights], device=self.device) for x in (scene.beam_axis, scene.beam_cosine))
        context = encode_guided(self.model, inputs, *beams, progress)
        return EncodedScene(scene, context, LightPrior(scene, self.device))

    def image(self, encoded: EncodedScene, view: View, guides: Guides, progress) -> torch.Tensor:
        tensors = guide_tensors(encoded.scene, view, guides, encoded.prior, lambda: progress("Light prior", 0.0))
        origin, rays = (torch.from_numpy(x).to(self.device)[None] for x in view_rays(view))
        raw = view_guided(self.model, encoded.context, origin, rays, tensors,
                          lambda text, fraction: progress(text, 0.1 + 0.9 * fraction))
        return decode_image(raw, tensors, lambda: progress("Decoding the light", 1.0))[0]
