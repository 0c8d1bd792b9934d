# SPDX-License-Identifier: GPL-3.0-or-later
"""ModelConfig: every size and switch of the network, and the two presets (spec/network.md 1)."""
from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace

from ..errors import CheckpointError

# Switches of the published configuration that this implementation has only in one position; the other positions
# belong to older checkpoints (spec/network.md 16).
_FIXED = {
    "register_token_pe": "weighted_mean", "use_view_token": False, "activation": "swiglu", "norm_type": "rms_norm",
    "norm_first": True, "bias": False, "view_indep_qk_norm": True, "qk_norm": True, "pe_type": "rope_only_center",
    "rope_type": "triangle_center", "rope_double_max_freq": False, "use_vn_encoder": True,
    "vn_encoder_norm_type": "rms_norm", "texture_encoder_norm_type": "rms_norm", "log_roughness_encoding": False,
    "separate_light_strength": True, "auto_interpolate_texture": True, "envmap_encoder_norm_type": "rms_norm",
    "use_triangle_ordering": True, "triangle_ordering_order": "hilbert", "put_light_tokens_first": True,
    "put_light_tokens_in_sink": True, "put_env_tokens_in_sink": True, "add_summary_tokens": True,
    "volume_use_density_mlp": True, "use_perceiver": False, "decoding_method": "view_transformer",
    "view_transformer_include_self_attn": True, "view_transformer_self_attn_before_cross": False,
    "view_transformer_use_swin_attn": True, "vdir_pe_type": "nerf", "latent_vae_model_id": None,
    "include_alpha": False, "use_dpt_decoder": True, "view_transformer_use_layers": None,
    "deepstack_injection_map": None, "deepstack_decoder_injection_map": None,
}

_AT_LEAST_ONE = (
    "latent_dim", "num_layers", "num_heads", "dim_feedforward", "texture_encode_patch_size", "texture_channels",
    "envmap_latent_patch_size", "envmap_latent_channels", "envmap_ray_dir_map_patch_size", "summary_block_size",
    "volume_density_input_dim", "view_transformer_latent_dim", "view_transformer_ffn_hidden_dim",
    "view_transformer_n_heads", "view_transformer_n_layers", "patch_size", "dpt_features",
)


def _is_count(value) -> bool:
    return type(value) is int and value >= 0


_FITS = {  # by the annotation of a field
    "int": _is_count, "bool": lambda value: type(value) is bool, "str": lambda value: type(value) is str,
    "float": lambda value: type(value) in (int, float), "dict": lambda value: type(value) is dict,
    "tuple[int, ...]": lambda value: type(value) is tuple and all(map(_is_count, value)),
}


@dataclass(frozen=True)
class ModelConfig:
    """Field names and defaults are those of `model_config` in a published config.yaml; our own fields come last."""

    latent_dim: int = 384
    num_layers: int = 16
    num_heads: int = 8
    num_kv_heads: int | None = None
    dim_feedforward: int = 1536
    num_register_tokens: int = 16
    register_token_pe: str = "weighted_mean"
    use_view_token: bool = True
    dropout: float = 0.1
    activation: str = "gelu"
    norm_type: str = "layer_norm"
    norm_first: bool = False
    bias: bool = True
    view_indep_qk_norm: bool = False
    qk_norm: bool = False
    pe_type: str = "nerf"
    rope_type: str = "triangle"
    rope_double_max_freq: bool = False
    vertex_pe_num_freqs: int = 6
    intra_rope_pe_num_freqs: int = 20
    use_vn_encoder: bool = False
    vn_pe_num_freqs: int = 6
    vn_encoder_norm_type: str = "none"
    texture_encode_patch_size: int = 32
    texture_channels: int = 13
    texture_encoder_norm_type: str = "layer_norm"
    log_roughness_encoding: bool = False
    separate_light_strength: bool = False
    auto_interpolate_texture: bool = False
    use_env_lighting: bool = False
    envmap_vae_model_id: str | None = None
    envmap_latent_patch_size: int = 8
    envmap_latent_channels: int = 16
    envmap_ray_dir_map_patch_size: int = 64
    envmap_encoder_norm_type: str = "layer_norm"
    use_triangle_ordering: bool = False
    triangle_ordering_order: str = "z"
    view_transformer_use_triangle_ordering: bool = False
    view_transformer_triangle_ordering_order: str = "z"
    use_local_attention: bool = False
    local_attention_window_size_half: int = 256
    use_flex_attention: bool = False
    flex_attention_block_size: int = 128
    put_light_tokens_first: bool = False
    put_light_tokens_in_sink: bool = True
    put_env_tokens_in_sink: bool = True
    add_summary_tokens: bool = False
    summary_block_size: int = 64
    use_volumes: bool = False
    volume_density_input_dim: int = 64
    volume_use_density_mlp: bool = True
    use_perceiver: bool = False
    num_perceiver_tokens: int = 64
    decoding_method: str = "texture_patch"
    texture_decode_patch_size: int = 32
    view_transformer_latent_dim: int = 384
    view_transformer_ffn_hidden_dim: int = 1536
    view_transformer_n_heads: int = 8
    view_transformer_num_kv_heads: int | None = None
    view_transformer_n_layers: int = 10
    view_transformer_include_self_attn: bool = True
    view_transformer_self_attn_before_cross: bool = False
    view_transformer_use_swin_attn: bool = False
    vdir_pe_type: str = "nerf"
    vdir_num_freqs: int = 0
    patch_size: int = 8
    output_patch_size: int | None = None
    output_channel: int | None = None
    latent_vae_model_id: str | None = None
    include_alpha: bool = False
    freeze_radiosity_transformer_if_initialized: bool = False
    use_dpt_decoder: bool = False
    dpt_features: int = 128
    dpt_out_channels: tuple[int, ...] = (96, 192, 384, 768)
    dpt_out_layers: tuple[int, ...] | None = None
    view_transformer_use_layers: tuple[int, ...] | None = None
    custom_init: bool = False
    deepstack_injection_map: dict | None = None
    deepstack_dual_input_size: int = 64
    deepstack_decoder_injection_map: dict | None = None

    # our own
    guided: bool = False            # first-hit guides, light prior and light decoding; off = the paper's network
    embed_norm_eps: float = 1e-6    # spec/network.md 3: the official CPU path uses 1.1920929e-7
    dense: bool = False             # stage 1 without the window (spec/network.md 7, the packed path)
    tile_encoder_channels: int = 0  # width of our own material tile encoder; 0 = latents are given
    env_encoder: bool = False       # our own environment encoder; False = latents are given
    decoder_extra_channels: int = 0  # full-resolution channels that join before the decoder's output_conv2

    def __post_init__(self) -> None:
        for name in ("dpt_out_channels", "dpt_out_layers"):
            if isinstance(getattr(self, name), list):
                object.__setattr__(self, name, tuple(getattr(self, name)))

    @property
    def decoded_channels(self) -> int:
        """Channels that leave the decoder; without guidance `output_channel` is inert."""
        return self.output_channel or 3 if self.guided else 3

    @property
    def decoder_layers(self) -> tuple[int, ...]:
        """The four view layers that the decoder reads."""
        return self.dpt_out_layers or tuple(range(self.view_transformer_n_layers))[-4:]

    def validate(self) -> ModelConfig:
        """Return self; raises CheckpointError for a network that this implementation does not have."""
        for field in fields(self):
            value, wanted = getattr(self, field.name), field.type.removesuffix(" | None")
            if not (_FITS[wanted](value) or value is None and wanted != field.type):
                raise CheckpointError(f"{field.name} = {value!r} is not of the kind {field.type}")
        for name in _AT_LEAST_ONE:
            if getattr(self, name) < 1:
                raise CheckpointError(f"{name} = {getattr(self, name)} must be at least 1")
        for name, value in _FIXED.items():
            if getattr(self, name) != value:
                raise CheckpointError(f"{name} = {getattr(self, name)!r} is not supported, only {value!r}: "
                                      "this is not a RenderFormer-V2 checkpoint")
        for width, heads, kv_heads in (
                (self.latent_dim, self.num_heads, self.num_kv_heads),
                (self.view_transformer_latent_dim, self.view_transformer_n_heads, self.view_transformer_num_kv_heads)):
            if width % heads or (width // heads) % 2:
                raise CheckpointError(f"a width of {width} cannot be split into {heads} heads of even width")
            if kv_heads not in (None, heads):
                raise CheckpointError(f"grouped queries ({kv_heads} key heads for {heads} heads) are not supported")
        if self.intra_rope_pe_num_freqs // 2 * 3 > self.latent_dim // self.num_heads // 2:
            raise CheckpointError(f"intra_rope_pe_num_freqs = {self.intra_rope_pe_num_freqs} does not fit into heads "
                                  f"of width {self.latent_dim // self.num_heads}")
        if self.view_transformer_latent_dim != self.latent_dim:
            raise CheckpointError(f"stage widths differ: {self.latent_dim} and {self.view_transformer_latent_dim}")
        if (len(set(self.decoder_layers) & set(range(self.view_transformer_n_layers))) != 4
                or len(self.decoder_layers) != 4 or len(self.dpt_out_channels) != 4):
            raise CheckpointError(f"the decoder reads four view layers, the configuration names {self.decoder_layers}")
        return self

    def to_dict(self) -> dict:
        """JSON-ready mapping that `from_dict` reads back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, mapping: dict) -> ModelConfig:
        """Raises CheckpointError for an unknown key or an unsupported value."""
        unknown = sorted(map(str, set(mapping) - {f.name for f in fields(cls)}))
        if unknown:
            raise CheckpointError(f"unknown keys in model_config: {', '.join(unknown)}")
        return cls(**mapping).validate()


def rf2_200m() -> ModelConfig:
    """The published configuration: 207,578,027 parameters in 321 tensors (spec/network.md 1, column "released")."""
    return ModelConfig(
        **_FIXED, latent_dim=768, num_layers=12, num_heads=6, dim_feedforward=3072, dropout=0.0,
        vertex_pe_num_freqs=12, intra_rope_pe_num_freqs=40, vn_pe_num_freqs=6,
        texture_encode_patch_size=4, texture_channels=80, use_env_lighting=True,
        envmap_vae_model_id="Qwen/Qwen-Image", use_flex_attention=True, use_volumes=True,
        view_transformer_latent_dim=768, view_transformer_ffn_hidden_dim=3072, view_transformer_n_heads=6,
        view_transformer_n_layers=6, custom_init=True,
    )


def rf2_small() -> ModelConfig:
    """The bundled guided preset: the same mechanisms at a quarter of the width, with its own small encoders."""
    return replace(
        rf2_200m(), latent_dim=192, num_layers=6, num_heads=3, dim_feedforward=512, num_register_tokens=8,
        vertex_pe_num_freqs=6, intra_rope_pe_num_freqs=20, vn_pe_num_freqs=2, texture_channels=16,
        envmap_vae_model_id=None, envmap_latent_channels=8, envmap_ray_dir_map_patch_size=8,
        view_transformer_latent_dim=192, view_transformer_ffn_hidden_dim=512, view_transformer_n_heads=3,
        view_transformer_n_layers=4, dpt_features=48, dpt_out_channels=(24, 48, 96, 192), output_channel=21,
        guided=True, tile_encoder_channels=32, env_encoder=True, decoder_extra_channels=29,
    )


PRESETS = {"rf2_200m": rf2_200m, "rf2_small": rf2_small}
