# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage 2: ray bundles gather light from the scene tokens (spec/network.md 8)."""
from __future__ import annotations

from itertools import starmap

import torch
from torch import nn

from .attention import CrossAttention, KeysValues, attend_to_all
from .config import ModelConfig
from .decoder import DPTDecoder
from .embed import patches
from .feed_forward import SwiGLU
from .memory import CHUNK, Progress, chunked, cuts, joined
from .nerf import nerf_encode, nerf_width
from .norm import Linear, RMSNorm
from .rope import RotaryEmbedding
from .sequence import learned_token
from .swin import SwinAttention


class ViewDependentLayer(nn.Module):
    """Cross-attention to the scene, Swin self-attention between bundles, SwiGLU; all pre-norm."""

    def __init__(self, config: ModelConfig, index: int):
        super().__init__()
        d, heads = config.view_transformer_latent_dim, config.view_transformer_n_heads
        self.multihead_attn = CrossAttention(d, heads)
        self.query_norm = RMSNorm(d)
        self.kv_norm = RMSNorm(d)
        self.self_attn = SwinAttention(d, heads, shifted=index % 2 == 1)
        self.self_attn_norm = RMSNorm(d)
        self.ffn = SwiGLU(d, config.view_transformer_ffn_hidden_dim)
        self.ffn_norm = RMSNorm(d)

    def keys_values(self, tokens: torch.Tensor, rotation, progress: Progress = Progress()) -> KeysValues:
        """What (L, D) scene tokens show to every ray bundle of every view."""
        def project(begin: int, end: int):
            return self.multihead_attn.keys_values(self.kv_norm(tokens[begin:end]), [x[begin:end] for x in rotation])

        return KeysValues.collect(project, cuts(0, len(tokens), tokens.device), progress)

    def forward(self, rays: torch.Tensor, rotation, keys: KeysValues, progress: Progress) -> torch.Tensor:
        """(V, Hg, Wg, D) float32 -> same; `rotation` is for V Hg Wg rows."""
        shape = rays.shape
        rays = rays.flatten(0, 2)
        rays = self.cross_attend(rays, rotation, keys, progress.part(0.0, 0.5)).view(shape)
        rays = (rays + self.self_attn(rays, self.self_attn_norm, progress.part(0.5, 0.7))).flatten(0, 2)
        return chunked(lambda x: x + self.ffn(self.ffn_norm(x)), rays, progress=progress.part(0.7, 1.0),
                       into=rays).view(shape)

    def cross_attend(self, rays: torch.Tensor, rotation, keys: KeysValues, progress: Progress) -> torch.Tensor:
        """(n, D) -> (n, D) with what it sees of the scene added."""
        def update(begin: int, end: int) -> torch.Tensor:
            x, turn = rays[begin:end], [part[begin:end] for part in rotation]
            q = self.multihead_attn.queries(self.query_norm(x), turn).transpose(0, 1)
            step = progress.part(begin / len(rays), end / len(rays))
            return x + self.multihead_attn.output(attend_to_all(q, keys, step))

        return joined(starmap(update, cuts(0, len(rays), rays.device)), len(rays), axis=0)


class ViewDependentTransformer(nn.Module):
    """The stack of stage 2."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        head_width = config.view_transformer_latent_dim // config.view_transformer_n_heads
        self.rope_emb = RotaryEmbedding(min(config.intra_rope_pe_num_freqs, 2 * (head_width // 6)), head_width)
        self.layers = nn.ModuleList(
            ViewDependentLayer(config, index) for index in range(config.view_transformer_n_layers))


class ViewTransformer(nn.Module):
    """Ray bundles -> image."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config
        d = config.view_transformer_latent_dim
        self.ray_map_patch_token = learned_token(1, d)
        self.ray_map_encoder = Linear(nerf_width(3, config.vdir_num_freqs) * config.patch_size ** 2, d)
        self.ray_map_encoder_norm = RMSNorm(d, config.embed_norm_eps)
        self.transformer = ViewDependentTransformer(config)
        self.out_dpt = DPTDecoder(config)

    def embed_rays(self, rays_d: torch.Tensor, progress: Progress | None = None) -> torch.Tensor:
        """(V, H, W, 3) world directions -> (V, R, D) float32, one token per 8x8 pixels (spec/network.md 8.1)."""
        side, token = self.config.patch_size, self.ray_map_patch_token.float()[0]

        def embed(directions: torch.Tensor) -> torch.Tensor:
            encoded = nerf_encode(directions, self.config.vdir_num_freqs).permute(0, 3, 1, 2)
            return token + self.ray_map_encoder_norm(self.ray_map_encoder(patches(encoded, side)))

        lines = rays_d.unflatten(1, (-1, side)).flatten(0, 1)  # (V H/8, 8, W, 3)
        tokens = chunked(embed, lines, size=max(CHUNK * side // rays_d.shape[2], 1), progress=progress)
        return tokens.view(len(rays_d), -1, tokens.shape[-1])

    def forward(self, rays: torch.Tensor, ray_positions: torch.Tensor, grid: tuple[int, int], keys_values,
                extra: torch.Tensor | None, progress: Progress) -> torch.Tensor:
        """(V, R, D) ray tokens at (V, R, 3) -> (V, C, H, W) float32, what the decoder says before the ELU.

        `keys_values(i, progress)` gives the scene's keys and values for layer i.
        """
        rotation = self.transformer.rope_emb(ray_positions.flatten(0, 1))
        rays = rays.unflatten(1, grid)
        count = len(self.transformer.layers)
        features = {}
        for i, layer in enumerate(self.transformer.layers):
            step = progress.part(0.85 * i / count, 0.85 * (i + 1) / count, f"Stage 2, layer {i + 1}/{count}")
            rays = layer(rays, rotation, keys_values(i, step.part(0.0, 0.3)), step.part(0.3, 1.0))
            if i in self.config.decoder_layers:
                features[i] = rays.permute(0, 3, 1, 2)
        return self.out_dpt([features[i] for i in self.config.decoder_layers], extra,
                            progress.part(0.85, 1.0, "Decoding the image"))
