# SPDX-License-Identifier: GPL-3.0-or-later
"""The RenderFormer-V2 network (docs/network.md; paper, figure of the architecture)."""
from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch.nn import functional as F

from ..compute.inference import current_pieces
from ..compute.precision import has_tensor_float_32
from ..progress import part
from .block_attention import KeysValues
from .config import ModelConfig
from .embedding import SceneEmbedding
from .inputs import NetworkInputs, ViewInputs
from .layers import store_in_precision
from .sequence import Tokens, centroids, pack, scene_centre
from .view_dependent import ViewTransformer
from .view_independent import ViewIndependentTransformer

KEYS_VALUES_BYTES = 5 << 29  # that stage 2 may cache of a scene between views: 65,536 published tokens in float32


@dataclass
class SceneContext:
    """A scene after stage 1, which any number of views share."""

    tokens: torch.Tensor     # (L, D) float32, packed order
    positions: torch.Tensor  # (L, 3) float32
    triangle: torch.Tensor   # (L,) int64, input row of a triangle token, else -1
    sink: int                # length of the part before the sorted tokens
    caches: bool = True      # whether `keys_values` are cached between views (L D numbers twice per layer)
    keys_values: dict[int, KeysValues] = field(default_factory=dict)  # by stage-2 layer


class RenderFormer(SceneEmbedding):
    """Scene tokens -> stage 1 -> per view: ray bundles -> stage 2 -> image."""

    def __init__(self, config: ModelConfig):
        super().__init__(config.validate())
        self.transformer = ViewIndependentTransformer(config)
        self.view_transformer = ViewTransformer(config)

    def forward(self, inputs: NetworkInputs, rays: ViewInputs) -> torch.Tensor:
        """A scene and V views of it -> (V, 3, H, W) log10(1 + radiance); the inverse is 10^y - 1."""
        return self.render_view(self.encode_scene(inputs), rays)

    def encode_scene(self, inputs: NetworkInputs, cache_keys_values: bool | None = None) -> SceneContext:
        """Embed, sort, summarise, pack, stage 1.

        cache_keys_values: whether views share stage 2's keys and values of the tokens; by their size when not given.
        """
        with part(0.0, 0.1, "Reading the scene"):
            sequence, sink = self.embed_scene(inputs)
        with part(0.1, 1.0):
            tokens = self.transformer(sequence.embedding, sequence.position, sink)
        if cache_keys_values is None:
            cache_keys_values = self.keys_values_bytes(len(tokens)) <= KEYS_VALUES_BYTES
        return SceneContext(tokens, sequence.position, sequence.triangle, sink, cache_keys_values)

    def embed_scene(self, inputs: NetworkInputs) -> tuple[Tokens, int]:
        """The packed sequence before stage 1, and the length of its sink."""
        triangles = self.embed_triangles(inputs)
        environment = None if inputs.environment is None else self.embed_environment(inputs.environment)
        cells = None if inputs.volumes is None else self.volume_encoder(inputs.volumes)
        tokens, first = arranged(inputs, self.config, self.reg_tokens.float()[0], environment, triangles, cells,
                                 self.transformer.summary_token_embed.float()[0])
        return tokens, first if self.config.sinks else 0

    def render_view(self, context: SceneContext, rays: ViewInputs) -> torch.Tensor:
        """Stage 2 and decoder for V views -> (V, C, H, W) float32, what `decode` returns.

        Raises ValueError when H or W is not a multiple of `ModelConfig.granularity`.
        """
        with part(0.0, 0.86):
            features = self.view_features(context, rays)
        with part(0.86, 1.0, "Painting the picture"):
            return self.decode(features, rays)

    def view_features(self, context: SceneContext, rays: ViewInputs) -> list[torch.Tensor]:
        """Stage 2 for V views -> (V, D, Hg, Wg) of each layer that the decoder reads. Raises as `render_view`."""
        height, width = rays.directions.shape[1:3]
        side, patch = self.config.granularity, self.config.patch_size
        if height % side or width % side or not height or not width:
            raise ValueError(f"the network renders multiples of {side} pixels, not {width} x {height}")
        with part(0.0, 0.02, "Preparing the view"):
            tokens = self.ray_tokens(context, rays)
        with part(0.02, 1.0):
            return self.view_transformer(tokens, self.ray_positions(rays), (height // patch, width // patch),
                                         lambda i: self.scene_keys_values(context, i))

    def ray_tokens(self, context: SceneContext, rays: ViewInputs) -> torch.Tensor:
        """(V, R, D) ray tokens before stage 2, which may know the scene."""
        return self.embed_rays(rays)

    def embed_rays(self, rays: ViewInputs) -> torch.Tensor:
        """(V, R, D) one token per ray bundle, row-major; R = H W / patch_size^2."""
        return self.view_transformer.embed_rays(rays.directions)

    def ray_positions(self, rays: ViewInputs) -> torch.Tensor:
        """(V, R, 3) where the ray tokens are: the camera (docs/network.md 8.1)."""
        views, height, width = rays.directions.shape[:3]
        return rays.origin[:, None].expand(views, height * width // self.config.patch_size ** 2, 3)

    def decode(self, features: list[torch.Tensor], rays: ViewInputs) -> torch.Tensor:
        """Features of four layers -> (V, 3, H, W) log10(1 + radiance)."""
        return F.elu(self.view_transformer.out_dpt(features), alpha=0.001)

    def scene_keys_values(self, context: SceneContext, index: int) -> KeysValues:
        """Keys and values of the scene for stage-2 layer `index`."""
        caches = context.caches and not current_pieces().are_small  # a card that is too small caches nothing
        if not caches:
            context.keys_values.clear()
        if index in context.keys_values:
            return context.keys_values[index]
        stage = self.view_transformer.transformer
        result = stage.layers[index].keys_values(context.tokens, stage.rope_emb(context.positions))
        if caches:
            context.keys_values[index] = result
        return result

    def keys_values_bytes(self, length: int) -> int:
        """Size of the keys and values of all stage-2 layers for a sequence of `length` tokens."""
        layers = self.view_transformer.transformer.layers
        attention = layers[0].multihead_attn
        dtype = attention.dtype or attention.k_proj.weight.dtype
        return 2 * len(layers) * length * self.config.latent_dim * dtype.itemsize


def arranged(inputs: NetworkInputs, config: ModelConfig, registers: torch.Tensor, environment: torch.Tensor | None,
             triangles: torch.Tensor, cells: torch.Tensor | None, summary: torch.Tensor) -> tuple[Tokens, int]:
    """A scene's packed sequence of these embeddings (n, D), and how many tokens stand before the sorted ones.

    environment and cells, of volumes, may be None; summary (1, D) is added to the means of sorted tokens.
    """
    centre = scene_centre(inputs.triangles)
    fixed = [Tokens.at(embedding, centre) for embedding in (registers, environment) if embedding is not None]
    surfaces = Tokens(triangles, centroids(inputs.triangles), torch.arange(len(triangles), device=triangles.device))
    volumes = [] if cells is None else [Tokens.at(cells, inputs.volumes.position)]
    first = inputs.is_light if config.light_sinks else torch.zeros_like(inputs.is_light)
    return pack(fixed, surfaces, first, volumes, config.summary_block_size if config.summaries else 0, summary)


def to_radiance(log_image: torch.Tensor) -> torch.Tensor:
    """Log image -> linear radiance, 10^y - 1."""
    return torch.pow(10.0, log_image.float()) - 1


def store_as_released(network: RenderFormer, dtype: torch.dtype, device: torch.device) -> RenderFormer:
    """In the precision of the authors' `release` profile (docs/network.md 11): stage 2 without its decoder stays in
    float32 where the device has TensorFloat-32, but for its cross-attention; all else is in `dtype`."""
    return store_with_exact_view(network, dtype) if has_tensor_float_32(device) else store_in_precision(network, dtype)


def store_with_exact_view(network: RenderFormer, dtype: torch.dtype) -> RenderFormer:
    """Weights of stage 2 without its decoder stay in float32; all others, and the products of queries, keys and values
    in its cross-attention, are in `dtype`."""
    stage2 = network.view_transformer
    # Float32 keeps cross-attention, most of the work of large pictures, from Flash. With bfloat16 there pictures are
    # 56.5 dB or more from float32's, as without, where 50 are asked for (docs/measured.md 4); float16 rounds less.
    for layer in stage2.transformer.layers:
        layer.multihead_attn.dtype = dtype
    return store_in_precision(network, dtype, (stage2.ray_map_encoder, stage2.transformer))
