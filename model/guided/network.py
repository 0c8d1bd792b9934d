# SPDX-License-Identifier: GPL-3.0-or-later
"""The guided networks: the paper's transformer around estimated light (docs/architecture.md 4.2), or kernels alone."""
from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from ..compute.inference import chunked
from ..network.config import ModelConfig
from ..network.decoder import DPTDecoder
from ..network.inputs import EnvironmentInputs
from ..network.renderformer import RenderFormer
from ..progress import part
from ..weights.checkpoint import read_network
from .decoding import OUTPUTS
from .encoders import EnvironmentEncoder, Guidance, TileEncoder
from .features import FEATURES, GuidedView
from .guided_inputs import GuidedInputs
from .kernels import KernelPredictor


class GuidedRenderFormer(RenderFormer):
    """Replaces how textures, environment, light tokens, ray tokens and pixels are made; all else is RenderFormer."""

    def __init__(self, config: ModelConfig):
        super().__init__(config)
        self.tile_encoder = TileEncoder(config)
        self.environment_encoder = EnvironmentEncoder(config)
        self.guidance = Guidance(config)
        self.view_transformer.out_dpt = DPTDecoder(config, len(FEATURES), len(OUTPUTS))
        self.kernel_predictor = KernelPredictor(config.guidance.kernel_predictor_width)  # of finished pictures

    def embed_textures(self, tiles: Tensor) -> Tensor:
        """(T, 13, 2 q, 2 q) material tiles -> (T, D)."""
        with part(0.0, 0.5):
            latents = chunked(self.tile_encoder, tiles)
        with part(0.5, 1.0):
            return super().embed_textures(latents)

    def embed_environment(self, images: EnvironmentInputs) -> Tensor:
        """LDR and HDR image -> (64, D) float32."""
        latents = self.environment_encoder(torch.stack([images.ldr, images.hdr]).float()).float()
        return super().embed_environment(EnvironmentInputs(*latents, images.strength))

    def embed_triangles(self, inputs: GuidedInputs) -> Tensor:
        """Light triangles have beams."""
        beams = self.guidance.beams(inputs.beam_axis, inputs.beam_cosine)
        return super().embed_triangles(inputs).index_add(0, inputs.is_light.nonzero()[:, 0], beams.float())

    def embed_rays(self, view: GuidedView) -> Tensor:
        """Ray bundles have the features of their pixels."""
        return super().embed_rays(view) + self.guidance.bundles(view.features).float()

    def ray_positions(self, view: GuidedView) -> Tensor:
        """Ray bundles are at their first hits instead of the camera."""
        return view.positions

    def decode(self, features: list[Tensor], view: GuidedView) -> Tensor:
        """Four (V, D, Hg, Wg) -> (V, len(OUTPUTS), H, W) channels for `corrected_light`."""
        return self.view_transformer.out_dpt(features, view.features)

    def zero_outputs(self) -> None:
        """Leave light as it is: training begins there."""
        for p in self.view_transformer.out_dpt.scratch.output_conv2[-1].parameters():
            nn.init.zeros_(p)


class KernelNetwork(nn.Module):
    """What is bundled: kernels for finished pictures, without a transformer."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config.validate()
        self.kernel_predictor = KernelPredictor(config.guidance.kernel_predictor_width)


def new_network(config: ModelConfig) -> RenderFormer | KernelNetwork:
    """The network of a configuration, ready to be trained."""
    if config.guidance is None:
        return RenderFormer(config)
    return GuidedRenderFormer(config) if config.guidance.transformer else KernelNetwork(config)


def load_network(folder: Path) -> RenderFormer | KernelNetwork:
    """The network of a folder in this project's format. Raises CheckpointError."""
    return read_network(new_network, folder)
