# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage 1: light transport between scene tokens, independent of the camera (spec/network.md 7)."""
from __future__ import annotations

from itertools import starmap

import torch
from torch import nn

from .attention import KeysValues, SelfAttention, Window
from .config import ModelConfig
from .feed_forward import SwiGLU
from .memory import Progress, joined
from .norm import RMSNorm
from .rope import RotaryEmbedding
from .sequence import learned_token


class ViewIndependentLayer(nn.Module):
    """Pre-norm self-attention under the window + sink mask, then SwiGLU."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        d = config.latent_dim
        self.multihead_attn = SelfAttention(d, config.num_heads)
        self.query_norm = RMSNorm(d)
        self.ffn = SwiGLU(d, config.dim_feedforward)
        self.ffn_norm = RMSNorm(d)

    def forward(self, x: torch.Tensor, rotation, window: Window, progress: Progress) -> torch.Tensor:
        """(L, D) float32 -> (L, D) float32, block by block, so that no more than keys and values is held of all.

        Without gradients the result takes the place of x.
        """
        attention = self.multihead_attn

        def part(begin: int, end: int):
            return self.query_norm(x[begin:end]), [turn[begin:end] for turn in rotation]

        keys = KeysValues.collect(lambda begin, end: attention.keys_values(*part(begin, end)), window.cuts,
                                  progress.part(0.0, 0.2))

        def update(begin: int, end: int) -> torch.Tensor:
            q = attention.queries(*part(begin, end)).transpose(0, 1)
            step = progress.part(0.2 + 0.8 * begin / len(x), 0.2 + 0.8 * end / len(x))
            y = x[begin:end] + attention.output(window.attend(q, begin, keys, step))
            return y + self.ffn(self.ffn_norm(y))

        return joined(starmap(update, window.cuts), len(x), axis=0, into=x)


class ViewIndependentTransformer(nn.Module):
    """The stack of stage 1; no norm afterwards."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.half = None if config.dense else config.local_attention_window_size_half
        self.summary_token_embed = learned_token(1, config.latent_dim)
        self.rope_emb = RotaryEmbedding(config.intra_rope_pe_num_freqs, config.latent_dim // config.num_heads)
        self.layers = nn.ModuleList(ViewIndependentLayer(config) for _ in range(config.num_layers))

    def forward(self, tokens: torch.Tensor, positions: torch.Tensor, sink: int, progress: Progress) -> torch.Tensor:
        """(L, D) float32 tokens at (L, 3) positions, the first `sink` of them dense -> (L, D) float32.

        Without gradients the result takes the place of the tokens.
        """
        rotation, window = self.rope_emb(positions), Window(len(tokens), sink, self.half, tokens.device)
        count = len(self.layers)
        for i, layer in enumerate(self.layers):
            step = progress.part(i / count, (i + 1) / count, f"Stage 1, layer {i + 1}/{count}")
            tokens = layer(tokens, rotation, window, step)
        return tokens
