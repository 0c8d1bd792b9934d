# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage 1: light transport between scene tokens, independent of the camera (docs/network.md 7)."""
from __future__ import annotations

import torch
from torch import nn

from ..compute.inference import by_rows
from ..progress import steps
from .attention import SelfAttention
from .block_attention import KeysValues, Window
from .config import ModelConfig
from .layers import RMSNorm, RotaryEmbedding, Rotation, SwiGLU, learned_token


class ViewIndependentLayer(nn.Module):
    """Pre-norm self-attention under the window + sink mask, then SwiGLU."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        d = config.latent_dim
        self.multihead_attn = SelfAttention(d, config.num_heads)
        self.query_norm = RMSNorm(d)
        self.ffn = SwiGLU(d, config.dim_feedforward)
        self.ffn_norm = RMSNorm(d)

    def forward(self, tokens: torch.Tensor, rotation: Rotation, window: Window) -> torch.Tensor:
        """(L, D) float32 -> (L, D) float32; inference writes the result over the tokens."""
        attention = self.multihead_attn

        def keys_values(rows: slice) -> tuple[torch.Tensor, torch.Tensor]:
            return attention.keys_values(self.query_norm(tokens[rows]), rotation[rows])

        def layer(rows: slice) -> torch.Tensor:
            x = tokens[rows]
            x = x + attention(self.query_norm(x), rotation[rows], keys, window, rows.start)
            return x + self.ffn(self.ffn_norm(x))

        keys = KeysValues.collect(keys_values, window.pieces, tokens.device)
        return by_rows(layer, window.pieces, tokens.device, into=tokens)


class ViewIndependentTransformer(nn.Module):
    """The stack of stage 1; no norm afterwards."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.half = None if config.dense else config.local_attention_window_size_half
        self.summary_token_embed = learned_token(1, config.latent_dim)
        self.rope_emb = RotaryEmbedding(config.intra_rope_pe_num_freqs, config.latent_dim // config.num_heads)
        self.layers = nn.ModuleList(ViewIndependentLayer(config) for _ in range(config.num_layers))

    def forward(self, tokens: torch.Tensor, positions: torch.Tensor, sink: int) -> torch.Tensor:
        """(L, D) float32 tokens at (L, 3) positions, the first `sink` of them dense -> (L, D) float32.

        Inference writes the result over the tokens.
        """
        rotation, window = self.rope_emb(positions), Window(len(tokens), sink, self.half, tokens.device)
        for layer in steps(self.layers, "Spreading light"):
            tokens = layer(tokens, rotation, window)
        return tokens
