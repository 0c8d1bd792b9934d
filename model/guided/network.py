# SPDX-License-Identifier: GPL-3.0-or-later
"""The guided network: the paper's transformer around estimated and traced light (docs/architecture.md 4.2)."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..compute.inference import chunked, current_pieces, is_inference
from ..network.config import ModelConfig
from ..network.inputs import EnvironmentInputs
from ..network.renderformer import RenderFormer, SceneContext
from ..pictures import BAND_PIXELS, bands
from ..progress import part, steps
from ..weights.checkpoint import read_network
from .bundle_decoder import CELLS, SAID, BundleDecoder, at_pixels
from .decoding import OF_PIXELS
from .encoders import BundleStatistics, EnvironmentEncoder, Guidance, TileEncoder
from .features import FEATURES, GuidedView
from .fusion import Fusion
from .guided_inputs import GuidedInputs
from .kernels import KernelPredictor
from .light_attention import LightAttention, Surfaces, bundles_of
from .pixel_decoder import PixelDecoder
from .reduced_view import reduced


@dataclass
class GuidedContext(SceneContext):
    """And what ray bundles attend to where no rays were traced."""

    surfaces: Surfaces | None = None


class GuidedRenderFormer(RenderFormer):
    """Replaces how textures, environment, light tokens, ray tokens and pixels are made; all else is RenderFormer."""

    def __init__(self, config: ModelConfig):
        super().__init__(config)
        self.tile_encoder = TileEncoder(config)
        self.environment_encoder = EnvironmentEncoder(config)
        self.guidance = Guidance(config)
        self.light_attention = LightAttention(config)
        width, coarse_width = config.guidance.pixel_decoder_width, config.guidance.pixel_decoder_coarse_width
        self.bundle_decoder = BundleDecoder(config)
        self.traced_fusion, self.rays_fusion = (Fusion(BundleStatistics.COUNT) for _ in range(2))
        self.pixel_decoder = PixelDecoder(len(FEATURES), width, len(OF_PIXELS), coarse_width)
        self.kernel_predictor = KernelPredictor(config.guidance.kernel_predictor_width)  # of finished pictures

    def embed_textures(self, tiles: Tensor) -> Tensor:
        """(T, 13, 2 q, 2 q) material tiles -> (T, D)."""
        with part(0.0, 0.5):
            latents = chunked(self.tile_encoder, tiles)
        with part(0.5, 1.0):
            return super().embed_textures(latents)

    def embed_environment(self, images: EnvironmentInputs) -> Tensor:
        """LDR and HDR image -> (64, D) float32; (B, 64, D) of B environments in one."""
        both = torch.stack([images.ldr, images.hdr], dim=-4).float()
        latents = self.environment_encoder(both.flatten(0, -4)).float().unflatten(0, both.shape[:-3])
        return super().embed_environment(EnvironmentInputs(*latents.unbind(-4), images.strength))

    def embed_triangles(self, inputs: GuidedInputs) -> Tensor:
        """Light triangles have beams."""
        beams = self.guidance.beams(inputs.beam_axis, inputs.beam_cosine)
        return super().embed_triangles(inputs).index_add(0, inputs.is_light.nonzero()[:, 0], beams.float())

    def encode_scene(self, inputs: GuidedInputs, cache_keys_values: bool | None = None) -> GuidedContext:
        """And the surfaces that the sequence has tokens of."""
        context = super().encode_scene(inputs, cache_keys_values)
        return GuidedContext(**vars(context), surfaces=Surfaces.of_scene(context.tokens, context.triangle, inputs))

    def ray_tokens(self, context: GuidedContext, view: GuidedView) -> Tensor:
        """Where no rays were traced, bundles look for the light of surfaces, and for what hides emitters."""
        rays = self.embed_rays(view)
        return rays + self.found_light(rays, view, context.surfaces)

    def found_light(self, rays: Tensor, view: GuidedView, surfaces: Surfaces) -> Tensor:
        """What `LightAttention` adds to the ray tokens (V, R, D) of views, where there are no rays.

        surfaces: of B scenes; the same number of views belongs to each.
        """
        bundles = bundles_of(rays, view, len(surfaces.tokens), self.config.patch_size)
        light = self.light_attention(bundles, surfaces).reshape(rays.shape)
        return light * (1 - view.light.has_rays.view(-1, 1, 1))

    def embed_rays(self, view: GuidedView) -> Tensor:
        """Ray bundles have the features of their pixels."""
        return super().embed_rays(view) + self.guidance.bundles(view).float()

    def ray_positions(self, view: GuidedView) -> Tensor:
        """Ray bundles are at their first hits instead of the camera."""
        return view.positions

    def render_view(self, context: GuidedContext | None, view: GuidedView, reduction: int = 1) -> Tensor:
        """Stage 2, fusion and decoders for V views -> what `decode` returns.

        context: not needed where estimates are by rays, which the scene's tokens do not change. reduction: ray bundles
        are those of pictures smaller by this factor. Raises ValueError as RenderFormer does.
        """
        with part(0.0, 0.86, "Gathering light"):
            bundles = reduced(view, reduction, self.config)
            cells = self.say(None if view.light.is_by_rays() else self.view_features(context, bundles)[-1], bundles)
        with part(0.86, 1.0, "Painting the picture"):
            return self.decode(cells, view, reduction)

    def say(self, features: Tensor | None, view: GuidedView) -> Tensor:
        """(V, D, Hg, Wg) of the last layer -> (V, len(SAID) + 1, h, w): factors and trust of the cells of ray bundles.

        features: none where the factors would not count.
        """
        grid = tuple(size // self.config.patch_size for size in view.directions.shape[1:3])
        factors = (view.directions.new_zeros(len(view.directions), len(SAID), *(CELLS * side for side in grid))
                   if features is None else self.bundle_decoder(features))
        trust = torch.zeros_like(factors[:, :1])
        if not is_inference() or view.light.is_by_rays():
            statistics, traced = self.guidance.statistics.of(view.features()), view.light.is_traced
            for fusion, share in ((self.traced_fusion, traced), (self.rays_fusion, view.light.has_rays - traced)):
                if not is_inference() or share.any():
                    trust = trust + fusion(statistics, view.positions, grid) * share.view(-1, 1, 1, 1)
        return torch.cat([factors, trust], 1)

    def decode(self, cells: Tensor, view: GuidedView, reduction: int = 1) -> Tensor:
        """What bundles say -> (V, len(OUTPUTS), H, W) for `corrected_light` and the kernels."""
        cell = self.config.patch_size * reduction // CELLS

        def decode(rows: slice) -> Tensor:
            return torch.cat([self.pixel_decoder(view.features(rows)), at_pixels(cells, rows, width, cell)], 1)

        height, width = view.directions.shape[1:3]
        if not is_inference():
            return decode(slice(0, height))
        reach = self.pixel_decoder.reach
        pixels = current_pieces().limit(max(BAND_PIXELS, 4 * reach * width))  # margins are computed twice
        return torch.cat([decode(outer)[..., inner, :] for outer, inner in steps(bands(
            height, width, margin=reach, pixels=pixels, multiple=2))], -2)


def new_network(config: ModelConfig) -> RenderFormer:
    """The network of a configuration, ready to be trained."""
    return RenderFormer(config) if config.guidance is None else GuidedRenderFormer(config)


def load_network(folder: Path) -> RenderFormer:
    """The network of a folder in this project's format. Raises CheckpointError."""
    return read_network(new_network, folder)
