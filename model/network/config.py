# SPDX-License-Identifier: GPL-3.0-or-later
"""ModelConfig: every size and switch that the network reads (docs/network.md 1)."""
from __future__ import annotations

from dataclasses import asdict, dataclass, fields

from ..errors import CheckpointError

SWIN_WINDOW = 8  # ray tokens along a side (docs/network.md 8.3)
ENVIRONMENT_GRID = (4, 8)  # patches of a panorama, rows x columns

_AT_LEAST_ONE = (
    "latent_dim", "num_layers", "num_heads", "dim_feedforward", "texture_encode_patch_size", "texture_channels",
    "envmap_latent_patch_size", "envmap_latent_channels", "envmap_ray_dir_map_patch_size", "summary_block_size",
    "volume_density_input_dim", "view_transformer_latent_dim", "view_transformer_ffn_hidden_dim",
    "view_transformer_n_heads", "view_transformer_n_layers", "patch_size", "dpt_features",
)


def is_count(value) -> bool:
    return type(value) is int and value >= 0


FITS = {  # by the annotation of a field
    "int": is_count, "bool": lambda value: type(value) is bool, "str": lambda value: type(value) is str,
    "float": lambda value: type(value) in (int, float), "dict": lambda value: type(value) is dict,
    "tuple[int, ...]": lambda value: type(value) is tuple and all(map(is_count, value)),
    "Guidance": lambda value: isinstance(value, Guidance),
}


def require_kind(name: str, value, annotation: str) -> None:
    """Raises CheckpointError unless the value is what the annotation says."""
    expected = annotation.removesuffix(" | None")
    if not (FITS[expected](value) or value is None and expected != annotation):
        raise CheckpointError(f"{name} = {value!r} is not of the kind {annotation}")


@dataclass(frozen=True)
class Guidance:
    """What the guided network has beside the paper's, and sizes of that (docs/architecture.md 4.2)."""

    tile_encoder_width: int = 32
    environment_encoder_width: int = 32
    pixel_decoder_width: int = 32
    pixel_decoder_coarse_width: int = 0  # of layers of half resolution; 0: there are none
    kernel_predictor_width: int = 32


@dataclass(frozen=True)
class ModelConfig:
    """Field names and defaults are those of `model_config` in a published config.yaml; our own fields come last."""

    latent_dim: int = 384
    num_layers: int = 16
    num_heads: int = 8
    dim_feedforward: int = 1536
    num_register_tokens: int = 16
    vertex_pe_num_freqs: int = 6
    intra_rope_pe_num_freqs: int = 20
    vn_pe_num_freqs: int = 6
    texture_encode_patch_size: int = 32
    texture_channels: int = 13
    use_env_lighting: bool = False
    envmap_latent_patch_size: int = 8
    envmap_latent_channels: int = 16
    envmap_ray_dir_map_patch_size: int = 64
    local_attention_window_size_half: int = 256
    summary_block_size: int = 64
    use_volumes: bool = False
    volume_density_input_dim: int = 64
    view_transformer_latent_dim: int = 384
    view_transformer_ffn_hidden_dim: int = 1536
    view_transformer_n_heads: int = 8
    view_transformer_n_layers: int = 10
    vdir_num_freqs: int = 0
    patch_size: int = 8
    dpt_features: int = 128
    dpt_out_channels: tuple[int, ...] = (96, 192, 384, 768)
    dpt_out_layers: tuple[int, ...] | None = None

    # our own
    embed_norm_eps: float = 1e-6      # docs/network.md 3: the official CPU path uses 1.1920929e-7
    dense: bool = False               # stage 1 without the window (docs/network.md 7, the packed path)
    sinks: bool = True                # registers and environment see and are seen by all; else none of the tokens are
    light_sinks: bool = True          # lights see and are seen by all; else they are sorted among the others
    summaries: bool = True            # a token for each run of sorted tokens
    guidance: Guidance | None = None  # None: the paper's network, key for key

    def __post_init__(self) -> None:
        for name in ("dpt_out_channels", "dpt_out_layers"):
            if isinstance(getattr(self, name), list):
                object.__setattr__(self, name, tuple(getattr(self, name)))

    @property
    def decoder_layers(self) -> tuple[int, ...]:
        """The four view layers that the decoder reads."""
        return self.dpt_out_layers or tuple(range(self.view_transformer_n_layers))[-4:]

    @property
    def granularity(self) -> int:
        """Pixels: a picture's sides are multiples of a Swin window of ray bundles."""
        return self.patch_size * SWIN_WINDOW

    def sequence_length(self, lights: int, others: int) -> int:
        """Tokens of a scene of so many emitting triangles, and other triangles and volume cells (docs/network.md 5)."""
        rows, columns = ENVIRONMENT_GRID
        environment = 2 * rows * columns if self.use_env_lighting else 0  # LDR and HDR
        ordered = others if self.light_sinks else others + lights
        summaries = ordered // self.summary_block_size if self.summaries else 0
        return self.num_register_tokens + environment + lights + others + summaries

    def validate(self) -> ModelConfig:
        """Return self; raises CheckpointError for a network that this implementation does not have."""
        for field in fields(self):
            require_kind(field.name, getattr(self, field.name), field.type)
        for name in _AT_LEAST_ONE:
            if getattr(self, name) < 1:
                raise CheckpointError(f"{name} = {getattr(self, name)} must be at least 1")
        for width, heads in ((self.latent_dim, self.num_heads),
                             (self.view_transformer_latent_dim, self.view_transformer_n_heads)):
            if width % heads or (width // heads) % 2:
                raise CheckpointError(f"a width of {width} cannot be split into {heads} heads of even width")
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
        guidance = mapping.get("guidance")
        if isinstance(guidance, dict):
            mapping = mapping | {"guidance": _from_known(Guidance, guidance, "guidance")}
        return _from_known(cls, mapping, "model_config").validate()


def _from_known(kind: type, mapping: dict, where: str):
    unknown = sorted(map(str, set(mapping) - {f.name for f in fields(kind)}))
    if unknown:
        raise CheckpointError(f"unknown keys in {where}: {', '.join(unknown)}")
    return kind(**mapping)
