# SPDX-License-Identifier: GPL-3.0-or-later
"""The bundle in miniature: the one of the repository to go on with, a new one, and one with trained weights as a small
file.
"""
from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

from safetensors.torch import load_file

from renderformer_v2.model.network.config import ModelConfig
from renderformer_v2.model.published.bundle import load_transformer
from renderformer_v2.model.published.bundle_files import MAPPERS, SMALL
from renderformer_v2.model.weights.presets import WEIGHTS as BUNDLED_WEIGHTS
from renderformer_v2.model.weights.presets import rf2_200m
from tools.extension import ROOT
from tools.train.new_bundle import WEIGHTS, add_new_transformer, write_published

COMMITTED = ROOT / "tests" / "fixtures" / "room_bundle"
MATERIAL = BUNDLED_WEIGHTS / "material"  # the autoencoder, and the mapper that was trained with it


def tiny_config() -> ModelConfig:
    """The paper's architecture with 3 million parameters."""
    return replace(
        rf2_200m(), latent_dim=128, num_layers=4, num_heads=4, dim_feedforward=448, num_register_tokens=8,
        vertex_pe_num_freqs=6, intra_rope_pe_num_freqs=10, vn_pe_num_freqs=2, envmap_ray_dir_map_patch_size=4,
        local_attention_window_size_half=1024, view_transformer_latent_dim=128, view_transformer_ffn_hidden_dim=448,
        view_transformer_n_heads=4, view_transformer_n_layers=4, vdir_num_freqs=4, dpt_features=32,
        dpt_out_channels=(32, 48, 64, 96))


def begin(bundle: Path) -> None:
    """A new bundle but for its VAE and two of its mappers, which are still to be trained."""
    name = MAPPERS[-1]
    shutil.copytree(MATERIAL / name, bundle / name, dirs_exist_ok=True)
    add_new_transformer(bundle, tiny_config())


def pack(trained: Path, bundle: Path) -> None:
    """Copy a bundle whose weights become half precision, but for the frequencies of positions.

    What is there is replaced: training links the files of the bundle that it began with, and may have begun with this.
    """
    shutil.rmtree(bundle, ignore_errors=True)
    for name in (*MAPPERS, "vae"):
        shutil.copytree(trained / name, bundle / name)
    config = load_transformer(trained / SMALL).config
    state = load_file(trained / SMALL / WEIGHTS)
    exact = {name: tensor for name, tensor in state.items() if name.endswith("rope_emb.freqs")}
    write_published(bundle / SMALL, config, {name: tensor.half() for name, tensor in state.items()} | exact)
