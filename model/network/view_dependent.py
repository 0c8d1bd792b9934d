# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage 2: ray bundles gather light from the scene tokens (docs/network.md 8)."""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import nn

from ..compute.inference import CHUNK, by_rows, chunked, current_pieces, cuts, is_inference
from ..progress import steps
from .attention import CrossAttention, SwinAttention
from .block_attention import KeysValues
from .config import ModelConfig
from .decoder import DPTDecoder
from .embedding import patches
from .layers import Linear, RMSNorm, RotaryEmbedding, Rotation, SwiGLU, learned_token, nerf_encode, nerf_width


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

    def keys_values(self, tokens: torch.Tensor, rotation: Rotation) -> KeysValues:
        """Keys and values of (L, D) scene tokens, the same for every view."""
        def project(rows: slice) -> tuple[torch.Tensor, torch.Tensor]:
            return self.multihead_attn.keys_values(self.kv_norm(tokens[rows]), rotation[rows])

        return KeysValues.collect(project, cuts(0, len(tokens), tokens.device), tokens.device)

    def forward(self, rays: torch.Tensor, rotation: Rotation, keys: KeysValues) -> torch.Tensor:
        """(V, Hg, Wg, D) float32 -> same; `rotation` is for V Hg Wg rows."""
        grid, x = rays.shape, rays.flatten(0, 2)

        def gather(rows: slice) -> torch.Tensor:
            return x[rows] + self.multihead_attn(self.query_norm(x[rows]), rotation[rows], keys)

        rays = by_rows(gather, cuts(0, len(x), x.device), x.device).view(grid)
        x = (rays + self.self_attn(rays, self.self_attn_norm)).flatten(0, 2)
        size = current_pieces().sequence_rows(x.device) if is_inference() else 0
        return chunked(lambda x: x + self.ffn(self.ffn_norm(x)), x, size=size, into=x).view(grid)


class ViewDependentTransformer(nn.Module):
    """The stack of stage 2."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        head_width = config.view_transformer_latent_dim // config.view_transformer_n_heads
        self.rope_emb = RotaryEmbedding(min(config.intra_rope_pe_num_freqs, 2 * (head_width // 6)), head_width)
        self.layers = nn.ModuleList(
            ViewDependentLayer(config, index) for index in range(config.view_transformer_n_layers))


class ViewTransformer(nn.Module):
    """Ray bundles -> features of four layers, and the decoder from these to a picture."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config
        d = config.view_transformer_latent_dim
        self.ray_map_patch_token = learned_token(1, d)
        self.ray_map_encoder = Linear(nerf_width(3, config.vdir_num_freqs) * config.patch_size ** 2, d)
        self.ray_map_encoder_norm = RMSNorm(d, config.embed_norm_eps)
        self.transformer = ViewDependentTransformer(config)
        if config.guidance is None:  # the guided network has decoders of its own
            self.out_dpt = DPTDecoder(config)

    def embed_rays(self, directions: torch.Tensor) -> torch.Tensor:
        """(V, H, W, 3) world directions -> (V, R, D) float32, one token per ray bundle (docs/network.md 8.1)."""
        side, token = self.config.patch_size, self.ray_map_patch_token.float()[0]

        def embed(lines: torch.Tensor) -> torch.Tensor:
            encoded = nerf_encode(lines, self.config.vdir_num_freqs).permute(0, 3, 1, 2)
            return token + self.ray_map_encoder_norm(self.ray_map_encoder(patches(encoded, side)))

        lines = directions.unflatten(1, (-1, side)).flatten(0, 1)  # (V H/8, 8, W, 3)
        tokens = chunked(embed, lines, size=max(CHUNK * side // directions.shape[2], 1))
        return tokens.view(len(directions), -1, tokens.shape[-1])

    def forward(self, rays: torch.Tensor, positions: torch.Tensor, grid: tuple[int, int],
                keys_values: Callable[[int], KeysValues]) -> list[torch.Tensor]:
        """(V, R, D) ray tokens at (V, R, 3) -> four (V, D, Hg, Wg) for the decoder.

        `keys_values(i)` returns the scene's keys and values for layer i.
        """
        rotation = self.transformer.rope_emb(positions.flatten(0, 1))
        rays = rays.unflatten(1, grid)
        features = {}
        for i, layer in enumerate(steps(self.transformer.layers, "Gathering light")):
            rays = layer(rays, rotation, keys_values(i))
            if i in self.config.decoder_layers:
                features[i] = rays.permute(0, 3, 1, 2)
        return [features[i] for i in self.config.decoder_layers]
