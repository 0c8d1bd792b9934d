# SPDX-License-Identifier: GPL-3.0-or-later
"""About how much memory a card needs for a picture, before it is asked for it."""
from __future__ import annotations

from ..compute.inference import GPU_CHUNK
from .config import ModelConfig

FULL = 4             # bytes of a float32
STREAMS = 4          # copies of all tokens or ray tokens that exist at once: residual, result, normalised, rotated
DECODER = 4 << 10    # bytes of the published decoder for each pixel of a band


def card_bytes(config: ModelConfig, parameters: int, tokens: int, pixels: int, items: tuple[int, int], kept: int,
               band: int = 1 << 16) -> int:
    """An upper estimate for a scene of so many tokens and a picture of so many pixels.

    parameters: of all networks in the render's precision. items: bytes of a weight, and of one of stage 2. kept: bytes
    that stage 2 may keep of a scene. band: pixels that are decoded at once.
    """
    item, view_item = items
    width, rays = config.latent_dim, pixels // config.patch_size ** 2
    window = 256 + 2 * config.local_attention_window_size_half
    keys = 2 * tokens * width * item
    stage1 = STREAMS * tokens * width * FULL + keys + 16 * (window + tokens // config.summary_block_size) * (
        2 * width * item + 256 * (1 + config.num_heads * item))
    seen = 2 * tokens * width * view_item
    layers = config.view_transformer_n_layers * seen
    stage2 = tokens * width * FULL + max(seen, layers if layers <= kept else 0) + (
        2 * STREAMS + len(config.decoder_layers)) * rays * width * FULL
    pieces = 4 * GPU_CHUNK * max(config.dim_feedforward, config.view_transformer_ffn_hidden_dim) * FULL
    weights = parameters * item + (view_item - item) * view_parameters(config)
    return weights + max(stage1, stage2 + DECODER * min(pixels, band)) + pieces


def view_parameters(config: ModelConfig) -> int:
    """Of the layers of stage 2."""
    width = config.latent_dim
    return config.view_transformer_n_layers * width * (8 * width + 3 * config.view_transformer_ffn_hidden_dim)
