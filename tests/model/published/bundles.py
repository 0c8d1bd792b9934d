# SPDX-License-Identifier: GPL-3.0-or-later
"""A published bundle in miniature, with a VAE of the real class beside its transformers."""
import json
from dataclasses import replace
from pathlib import Path

import torch
from safetensors.torch import save_file

from renderformer_v2.model.material.mappers import MAPPERS
from renderformer_v2.model.network.config import ModelConfig
from renderformer_v2.model.weights.presets import rf2_200m
from tools.parity.cases import recipe_network, with_recipe_weights
from tools.train.new_bundle import write_published


def tiny_published_config() -> ModelConfig:
    return replace(
        rf2_200m(), latent_dim=48, num_layers=2, num_heads=2, dim_feedforward=64, num_register_tokens=3,
        vertex_pe_num_freqs=3, intra_rope_pe_num_freqs=8, vn_pe_num_freqs=2, texture_channels=4,
        envmap_latent_channels=2, envmap_ray_dir_map_patch_size=4, local_attention_window_size_half=5,
        summary_block_size=4, view_transformer_latent_dim=48, view_transformer_ffn_hidden_dim=64,
        view_transformer_n_heads=2, view_transformer_n_layers=4, dpt_features=8, dpt_out_channels=(6, 8, 10, 12))


def tiny_vae() -> torch.nn.Module:
    from diffusers import AutoencoderKLQwenImage
    return with_recipe_weights(AutoencoderKLQwenImage(base_dim=4, num_res_blocks=1))


def write_bundle(folder: Path, config: ModelConfig, transformers: tuple[str, ...] = ("transformer_512",)) -> Path:
    """What a render needs; every transformer has weights of its own."""
    config = replace(config, texture_channels=80, envmap_latent_channels=16)
    state = recipe_network(config).state_dict()
    for i, name in enumerate(transformers):
        write_published(folder / name, config,
                          {k: v * (1 if "freqs" in k else 0.9 ** i) for k, v in state.items()})
    for name, mapper in MAPPERS.items():
        size = {"hidden_dim": 16, "num_layers": 3, "latent_dim": 9}
        (folder / name).mkdir()
        (folder / name / "config.json").write_text(json.dumps(size))
        save_file(with_recipe_weights(mapper(**size), prefix=f"{name}/").state_dict(),
                  folder / name / "model.safetensors")
    tiny_vae().save_pretrained(folder / "vae")
    return folder
