# SPDX-License-Identifier: GPL-3.0-or-later
"""Operations of a forward pass by formula (docs/network.md 12), and the rate of this machine's matrix products."""
from __future__ import annotations

import math
import time

import torch

from renderformer_v2.model.network.config import SWIN_WINDOW, ModelConfig
from renderformer_v2.model.network.embedding import ENVIRONMENT_GRID
from renderformer_v2.model.network.layers import nerf_width

ENVIRONMENT_TOKENS = 2 * math.prod(ENVIRONMENT_GRID)  # LDR and HDR


def forward_flops(config: ModelConfig, triangles: int, lights: int, resolution: int) -> dict[str, int]:
    """FLOPs by part, two per multiply-add, for one square view of `resolution` pixels.

    triangles includes the lights. Only matrix products and convolutions count; encoders of our own, which the published
    network does not have, are left out. The decoder counts its 1x1 convolutions after the resize, as published.
    """
    d, hidden = config.latent_dim, config.dim_feedforward
    ordered = triangles - lights
    sink = config.num_register_tokens + ENVIRONMENT_TOKENS + ordered // config.summary_block_size + lights
    length, rays = sink + ordered, (resolution // config.patch_size) ** 2
    triangle = (nerf_width(9, config.vertex_pe_num_freqs) + nerf_width(9, config.vn_pe_num_freqs) + 3
                + config.texture_channels * config.texture_encode_patch_size ** 2)
    environment = (ENVIRONMENT_TOKENS * config.envmap_latent_channels * config.envmap_latent_patch_size ** 2
                   + ENVIRONMENT_TOKENS // 2 * 3 * config.envmap_ray_dir_map_patch_size ** 2)
    view_layers, view_hidden = config.view_transformer_n_layers, config.view_transformer_ffn_hidden_dim
    return {
        "embed": 2 * d * (triangle * triangles + environment),
        "stage1_linear": config.num_layers * length * (8 * d * d + 6 * d * hidden),
        "stage1_attention": config.num_layers * 4 * d * visible_pairs(
            sink, ordered, config.local_attention_window_size_half),
        "keys_values": view_layers * 4 * length * d * d,
        "cross_attention": view_layers * 4 * rays * length * d,
        "stage2_linear": view_layers * rays * (12 * d * d + 6 * d * view_hidden),
        "swin_attention": view_layers * 4 * SWIN_WINDOW ** 2 * rays * d,
        "decoder": rays * decoder_flops_per_ray(config),
    }


def stage1_flops(flops: dict[str, int]) -> int:
    """The part of `forward_flops` that does not depend on the camera, without the keys and values of stage 2."""
    return flops["embed"] + flops["stage1_linear"] + flops["stage1_attention"]


def visible_pairs(sink: int, ordered: int, half: int) -> int:
    """Query-key pairs of the window + sink mask."""
    band = ordered * (2 * half + 1) - half * (half + 1) if ordered >= half else ordered ** 2
    return sink * (sink + ordered) + ordered * sink + band


def decoder_flops_per_ray(config: ModelConfig) -> int:
    """Operations of the DPT decoder for a token of the ray grid."""
    d, c, width = config.view_transformer_latent_dim, config.dpt_out_channels, config.dpt_features
    unit, point = 4 * 9 * width ** 2, 2 * width ** 2  # a residual unit, a 1x1 convolution, per position
    reassemble = 2 * d * sum(c) + 32 * c[0] ** 2 + 8 * c[1] ** 2 + 18 * c[3] ** 2 // 4
    levels = 18 * width * (16 * c[0] + 4 * c[1] + c[2]) + 18 * width * c[3] // 4
    fusion = (unit // 4 + point) + (2 * unit + 4 * point) + (8 * unit + 16 * point) + (32 * unit + 64 * point)
    output = 64 * (9 * width ** 2 + 18 * (width // 2) * 32 + 2 * 32 * 3)
    return reassemble + levels + fusion + output


def product_rate(device: torch.device, dtype: torch.dtype, size: int = 4096, repeats: int = 3,
                 clock=time.perf_counter) -> float:
    """FLOP/s of one large matrix product, the best of some repeats; clock: seconds of what."""
    a = torch.randn(size, size, device=device).to(dtype)
    best = float("inf")
    for _ in range(repeats):
        begin = clock()
        (a @ a)[0, 0].item()
        best = min(best, clock() - begin)
    return 2 * size ** 3 / best
