# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage 1: light transport between scene tokens, independent of the camera (spec/network.md 7)."""
from __future__ import annotations

import torch
from torch import nn

from .attention import SelfAttention, dense_attention, window_sink_attention
from .config import ModelConfig
from .feed_forward import SwiGLU
from .norm import RMSNorm
from .progress import Progress, chunked
from .rope import RotaryEmbedding


class ViewIndependentLayer(nn.Module):
    """Pre-norm self-attention under the window + sink mask, then SwiGLU."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        d = config.latent_dim
        self.half = None if config.dense else config.local_attention_window_size_half
        self.multihead_attn = SelfAttention(d, config.num_heads)
        self.query_norm = RMSNorm(d)
        self.ffn = SwiGLU(d, config.dim_feedforward)
        self.ffn_norm = RMSNorm(d)

    def forward(self, x: torch.Tensor, rotation, sink: int, progress: Progress) -> torch.Tensor:
        """(L, D) float32 -> (L, D) float32."""
        q, k, v = (part.transpose(0, 1) for part in chunked(
            lambda x, *rotation: self.multihead_attn.project(self.query_norm(x), rotation),
            x, *rotation, progress=progress.part(0.0, 0.3)))
        if self.half is None:
            seen = dense_attention(q, k, v, progress.part(0.3, 0.5))
        else:
            seen = window_sink_attention(q, k, v, sink, self.half, progress.part(0.3, 0.5))
        del q, k, v  # 9 kB per token that the rest of the layer can use
        return chunked(self._update, x, seen.transpose(0, 1), progress=progress.part(0.5, 1.0))

    def _update(self, x: torch.Tensor, seen: torch.Tensor) -> torch.Tensor:
        x = x + self.multihead_attn.out_proj(seen.flatten(-2))
        return x + self.ffn(self.ffn_norm(x))


class ViewIndependentTransformer(nn.Module):
    """The stack of stage 1; no norm afterwards."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.summary_token_embed = nn.Parameter(0.02 * torch.randn(1, 1, config.latent_dim))
        self.rope_emb = RotaryEmbedding(config.intra_rope_pe_num_freqs, config.latent_dim // config.num_heads)
        self.layers = nn.ModuleList(ViewIndependentLayer(config) for _ in range(config.num_layers))

    def forward(self, tokens: torch.Tensor, positions: torch.Tensor, sink: int, progress: Progress) -> torch.Tensor:
        """(L, D) float32 tokens at (L, 3) positions, the first `sink` of them dense -> (L, D) float32."""
        rotation = self.rope_emb(positions)
        count = len(self.layers)
        for i, layer in enumerate(self.layers):
            step = progress.part(i / count, (i + 1) / count, f"Stage 1, layer {i + 1}/{count}")
            tokens = layer(tokens, rotation, sink, step)
        return tokens
