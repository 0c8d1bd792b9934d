# SPDX-License-Identifier: GPL-3.0-or-later
"""Networks by name, as training begins with them; importing this does not import PyTorch."""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..network.config import Guidance, ModelConfig

WEIGHTS = Path(__file__).parent
BUNDLED = "rf2_small"  # the preset whose weights come with the add-on


def rf2_200m() -> ModelConfig:
    """The published configuration: 207,578,027 parameters in 321 tensors (docs/network.md 1, column "released")."""
    return ModelConfig(
        latent_dim=768, num_layers=12, num_heads=6, dim_feedforward=3072, vertex_pe_num_freqs=12,
        intra_rope_pe_num_freqs=40, texture_encode_patch_size=4, texture_channels=80, use_env_lighting=True,
        use_volumes=True, view_transformer_latent_dim=768, view_transformer_ffn_hidden_dim=3072,
        view_transformer_n_heads=6, view_transformer_n_layers=6)


def rf2_small() -> ModelConfig:
    """The guided preset: the same mechanisms at a quarter of the width, with its own small encoders."""
    return replace(
        rf2_200m(), latent_dim=192, num_layers=6, num_heads=3, dim_feedforward=512, num_register_tokens=8,
        vertex_pe_num_freqs=6, intra_rope_pe_num_freqs=20, vn_pe_num_freqs=2, texture_channels=16,
        envmap_latent_channels=8, envmap_ray_dir_map_patch_size=8, view_transformer_latent_dim=192,
        view_transformer_ffn_hidden_dim=512, view_transformer_n_heads=3, view_transformer_n_layers=4, dpt_features=48,
        dpt_out_channels=(24, 48, 96, 192), guidance=Guidance(pixel_decoder_coarse_width=64))


PRESETS = {"rf2_200m": rf2_200m, "rf2_small": rf2_small}


def weights_folder(name: str | Path) -> Path:
    """The folder of a preset whose weights come with the add-on, or the folder that was named."""
    return WEIGHTS / name if name in PRESETS else Path(name)
