# SPDX-License-Identifier: GPL-3.0-or-later
"""The RenderFormer-V2 network (spec/network.md; paper, figure of the architecture)."""
from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch.nn import functional as F

from ..guided.guidance import Guidance
from .config import ModelConfig
from .embed import SceneEmbedding
from .inputs import NetworkInputs
from .memory import Progress
from .sequence import Tokens, centroids, pack, scene_centre
from .view_dependent import ViewTransformer
from .view_independent import ViewIndependentTransformer

KEYS_VALUES_BYTES = 5 << 29  # that stage 2 may keep of a scene between views: 65,536 published tokens in float32


@dataclass
class SceneContext:
    """A scene after stage 1: all that a view needs, reusable for any number of views."""

    tokens: torch.Tensor     # (L, D) float32, packed order
    positions: torch.Tensor  # (L, 3) float32
    triangle: torch.Tensor   # (L,) int64, input row of a triangle token, else -1
    sink: int                # length of the part before the sorted tokens
    keys_values: dict = field(default_factory=dict)  # stage-2 layer -> (keys, values)
    keep: bool = True        # keep keys and values between views (L D numbers twice per layer)


class RenderFormer(SceneEmbedding):
    """Scene tokens -> stage 1 -> per view: ray bundles -> stage 2 -> image."""

    def __init__(self, config: ModelConfig):
        super().__init__(config.validate())
        self.transformer = ViewIndependentTransformer(config)
        self.view_transformer = ViewTransformer(config)
        if config.guided:
            self.guidance = Guidance(config.latent_dim, config.embed_norm_eps)

    def forward(self, inputs: NetworkInputs, rays_o: torch.Tensor, rays_d: torch.Tensor,
                progress=None) -> torch.Tensor:
        """Cameras (V, 3) with ray maps (V, H, W, 3) -> (V, 3, H, W) log10(1 + radiance); the inverse is 10^y - 1."""
        progress = Progress(progress)
        context = self.encode_scene(inputs, progress=progress.part(0.0, 0.5))
        return self.render_view(context, rays_o, rays_d, progress=progress.part(0.5, 1.0))

    def encode_scene(self, inputs: NetworkInputs, *, light_embedding: torch.Tensor | None = None,
                     keep_keys_values: bool | None = None, progress=None) -> SceneContext:
        """Embed, sort, summarise, pack, stage 1.

        light_embedding: (number of lights, D), added to the light tokens, in the order of the input triangles.
        keep_keys_values: whether views share what stage 2 makes of the tokens; by its size when not given.
        progress: callback(text, fraction), called at least every 0.2 s; what it raises comes out here.
        """
        progress = progress if isinstance(progress, Progress) else Progress(progress)
        sequence, sink = self.embed_scene(inputs, light_embedding, progress.part(0.0, 0.1, "Embedding the scene"))
        tokens = self.transformer(sequence.embedding, sequence.position, sink, progress.part(0.1, 1.0))
        if keep_keys_values is None:
            keep_keys_values = self.keys_values_bytes(len(tokens)) <= KEYS_VALUES_BYTES
        return SceneContext(tokens, sequence.position, sequence.triangle, sink, keep=keep_keys_values)

    def keys_values_bytes(self, length: int) -> int:
        """Size of the keys and values of all stage-2 layers for a sequence of `length` tokens."""
        layers = self.view_transformer.transformer.layers
        return 2 * len(layers) * length * self.config.latent_dim * layers[0].multihead_attn.k_proj.weight.itemsize

    def embed_scene(self, inputs: NetworkInputs, light_embedding: torch.Tensor | None = None,
                    progress: Progress | None = None) -> tuple[Tokens, int]:
        """The packed sequence before stage 1, and the length of its sink."""
        is_light, progress = inputs.is_light, progress or Progress()
        embedded = self.embed_triangles(inputs, progress.part(0.0, 0.8))
        if light_embedding is not None:
            embedded = embedded.index_add(0, is_light.nonzero()[:, 0], light_embedding.float())
        triangles = Tokens(embedded, centroids(inputs.triangles),
                           torch.arange(len(embedded), device=embedded.device))
        centre = scene_centre(inputs.triangles)
        fixed = [Tokens.at(self.reg_tokens.float()[0], centre)]
        if inputs.environment is not None:
            fixed.append(Tokens.at(self.embed_environment(inputs.environment), centre))
        volumes = []
        if inputs.volumes is not None:
            volumes.append(Tokens.at(self.volume_encoder(inputs.volumes), inputs.volumes.position))
        return pack(fixed, triangles, is_light, volumes, self.config.summary_block_size,
                    self.transformer.summary_token_embed.float()[0], progress.part(0.8, 1.0))

    def render_view(self, context: SceneContext, rays_o: torch.Tensor, rays_d: torch.Tensor, *,
                    ray_embedding: torch.Tensor | None = None, ray_position: torch.Tensor | None = None,
                    extra: torch.Tensor | None = None, raw: bool = False, progress=None) -> torch.Tensor:
        """Stage 2 and decoder for V views: (V, 3) origins, (V, H, W, 3) directions -> (V, C, H, W) float32.

        ray_embedding: (V, R, D), added to the ray tokens; R = H W / 64, row-major.
        ray_position: (V, R, 3) or (V, 3) where the ray tokens are; the camera origin when not given.
        extra: (V, decoder_extra_channels, H, W) full-resolution features for the decoder.
        raw: return the decoder's channels instead of the log image.
        Raises ValueError when H or W is not a multiple of 64.
        """
        views, height, width = rays_d.shape[:3]
        if height % 64 or width % 64 or not height or not width:
            raise ValueError(f"the network renders multiples of 64 pixels, not {width} x {height}")
        progress = progress if isinstance(progress, Progress) else Progress(progress)
        rays = self.view_transformer.embed_rays(rays_d, progress.part(0.0, 0.02, "Embedding the rays"))
        if ray_embedding is not None:
            rays = rays + ray_embedding.float()
        position = rays_o if ray_position is None else ray_position
        position = (position[:, None] if position.dim() == 2 else position).expand(views, rays.shape[1], 3)
        decoded = self.view_transformer(
            rays, position, (height // self.config.patch_size, width // self.config.patch_size),
            lambda i, step: self.scene_keys_values(context, i, step), extra, progress.part(0.02, 1.0))
        return decoded if raw else F.elu(decoded, alpha=0.001)

    def scene_keys_values(self, context: SceneContext, index: int, progress: Progress | None = None):
        """What stage-2 layer `index` attends to: keys and values, (heads, L, head width) each."""
        if index in context.keys_values:
            return context.keys_values[index]
        stage = self.view_transformer.transformer
        result = stage.layers[index].keys_values(context.tokens, stage.rope_emb(context.positions), progress)
        if context.keep:
            context.keys_values[index] = result
        return result


def to_radiance(log_image: torch.Tensor) -> torch.Tensor:
    """Log image -> linear radiance, 10^y - 1."""
    return torch.pow(10.0, log_image.float()) - 1
