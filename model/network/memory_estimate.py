# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate the memory of a card that a picture needs, before it is allocated."""
from __future__ import annotations

from ..compute.inference import GPU_CHUNK
from .config import ModelConfig

FULL = 4             # bytes of a float32
STREAMS = 4          # copies of all tokens or ray tokens that exist at once: residual, result, normalised, rotated
ENDS = 3             # bands of keys that are cut off at an end of the sequence: copied, with masks of their own
DECODER = 4 << 10    # bytes of the published decoder for each pixel of a band


def estimate_card_bytes(config: ModelConfig, parameters: int, tokens: int, pixels: int, items: tuple[int, int],
                        cached: int, band: int = 1 << 16) -> int:
    """An upper estimate for a scene of so many tokens and a picture of so many pixels.

    parameters: of all networks in the render's precision. items: bytes of a weight, and of one of stage 2. cached:
    bytes that stage 2 may cache of a scene. band: pixels that are decoded at once. Where more memory is free, a render
    takes a part of it for larger pieces.
    """
    item, view_item = items
    width, rays = config.latent_dim, pixels // config.patch_size ** 2
    window = 256 + 2 * config.local_attention_window_size_half
    layer_keys = 2 * tokens * width * item
    stage1 = STREAMS * tokens * width * FULL + layer_keys + ENDS * window * (2 * width + 256) * item
    keys_values = 2 * tokens * width * item
    layers = config.view_transformer_n_layers * keys_values
    stage2 = tokens * width * FULL + max(keys_values, layers if layers <= cached else 0) + (
        2 * STREAMS + len(config.decoder_layers)) * rays * width * FULL
    pieces = 4 * GPU_CHUNK * max(config.dim_feedforward, config.view_transformer_ffn_hidden_dim) * FULL
    weights = parameters * item + (view_item - item) * count_view_parameters(config)
    return weights + max(stage1, stage2 + DECODER * min(pixels, band)) + pieces


def count_view_parameters(config: ModelConfig) -> int:
    """Weights in the matrices of stage 2's layers."""
    width = config.latent_dim
    return config.view_transformer_n_layers * width * (8 * width + 3 * config.view_transformer_ffn_hidden_dim)
