# SPDX-License-Identifier: GPL-3.0-or-later
"""`model_config` of a published config.yaml -> ModelConfig (docs/network.md 1 and 16)."""
from __future__ import annotations

from dataclasses import fields

from ..errors import CheckpointError
from ..network.config import ModelConfig, require_kind

# Switches that this implementation has only in one position: (that position, what a missing key means). The other
# positions belong to older checkpoints.
FIXED = {
    "register_token_pe": ("weighted_mean", "weighted_mean"), "use_view_token": (False, True),
    "activation": ("swiglu", "gelu"), "norm_type": ("rms_norm", "layer_norm"), "norm_first": (True, False),
    "bias": (False, True), "view_indep_qk_norm": (True, False), "qk_norm": (True, False),
    "pe_type": ("rope_only_center", "nerf"), "rope_type": ("triangle_center", "triangle"),
    "rope_double_max_freq": (False, False), "use_vn_encoder": (True, False),
    "vn_encoder_norm_type": ("rms_norm", "none"), "texture_encoder_norm_type": ("rms_norm", "layer_norm"),
    "log_roughness_encoding": (False, False), "separate_light_strength": (True, False),
    "auto_interpolate_texture": (True, False), "envmap_encoder_norm_type": ("rms_norm", "layer_norm"),
    "use_triangle_ordering": (True, False), "triangle_ordering_order": ("hilbert", "z"),
    "put_light_tokens_first": (True, False), "put_light_tokens_in_sink": (True, True),
    "put_env_tokens_in_sink": (True, True), "add_summary_tokens": (True, False),
    "volume_use_density_mlp": (True, True), "use_perceiver": (False, False),
    "decoding_method": ("view_transformer", "texture_patch"), "view_transformer_include_self_attn": (True, True),
    "view_transformer_self_attn_before_cross": (False, False), "view_transformer_use_swin_attn": (True, False),
    "vdir_pe_type": ("nerf", "nerf"), "latent_vae_model_id": (None, None), "include_alpha": (False, False),
    "use_dpt_decoder": (True, False), "view_transformer_use_layers": (None, None),
    "deepstack_injection_map": (None, None), "deepstack_decoder_injection_map": (None, None),
}
INERT = {  # known, but without influence on the network; by the kind of their value
    "dropout": "float", "envmap_vae_model_id": "str | None", "view_transformer_use_triangle_ordering": "bool",
    "view_transformer_triangle_ordering_order": "str", "use_local_attention": "bool", "use_flex_attention": "bool",
    "flex_attention_block_size": "int", "num_perceiver_tokens": "int", "texture_decode_patch_size": "int",
    "output_patch_size": "int | None", "output_channel": "int | None", "custom_init": "bool",
    "freeze_radiosity_transformer_if_initialized": "bool", "deepstack_dual_input_size": "int",
}
KEY_HEADS = {"num_kv_heads": "num_heads", "view_transformer_num_kv_heads": "view_transformer_n_heads"}
OWN = {"embed_norm_eps", "dense", "sinks", "light_sinks", "summaries", "guidance"}  # in no published file
READ = {f.name for f in fields(ModelConfig)} - OWN


def model_config(mapping: dict) -> ModelConfig:
    """Raises CheckpointError for an unknown key or an unsupported value."""
    unknown = sorted(map(str, set(mapping) - READ - set(FIXED) - set(INERT) - set(KEY_HEADS)))
    if unknown:
        raise CheckpointError(f"unknown keys in model_config: {', '.join(unknown)}")
    for name, (position, default) in FIXED.items():
        if mapping.get(name, default) != position:
            raise CheckpointError(f"{name} = {mapping.get(name, default)!r} is not supported, only {position!r}: "
                                  "this is not a RenderFormer-V2 checkpoint")
    for name, kind in INERT.items():
        if name in mapping:
            require_kind(name, mapping[name], kind)
    config = ModelConfig.from_dict({name: value for name, value in mapping.items() if name in READ})
    for name, heads in KEY_HEADS.items():
        if mapping.get(name) not in (None, getattr(config, heads)):
            raise CheckpointError(f"grouped queries ({mapping[name]} key heads for {getattr(config, heads)} heads) are "
                                  "not supported")
    return config
