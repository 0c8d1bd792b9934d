# SPDX-License-Identifier: GPL-3.0-or-later
"""The published bundle: two transformers, three mappers and the material autoencoder (docs/scene-input.md 12)."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import CheckpointError
from ..material.autoencoder import MaterialAutoencoder
from ..material.mappers import MAPPERS, Mapper
from ..network.config import ModelConfig
from ..network.renderformer import RenderFormer
from ..weights.checkpoint import build_network, load_component, read_network
from ..weights.files import (
    FORMAT,
    checkpoint_errors,
    read_json,
    require,
    require_folder,
    version_one,
    weights_file,
)
from .bundle_files import AUTOMATIC, MODEL_CONFIG, TRANSFORMER, require_parts, transformer_for
from .model_config import model_config

SECTIONS = {"model_config", "dataset_config", "trainer_config"}
# Trainer switches that change what the network is fed or returns; this implementation has the released position.
RELEASED_TRAINER = {"turn_to_cam_coord": False, "learn_ldr": False, "emission_area_encoding": False,
                    "clamped_hdr": False}
STANDALONE = FORMAT | {"format_version": 1}  # what the authors' code writes, with their names of the settings


@dataclass
class Bundle:
    """The folder of renderformer-v2; its parts are read when they are asked for."""

    folder: Path

    @checkpoint_errors()
    def __post_init__(self) -> None:
        """Raises CheckpointError when there is no such folder, or it is of another model."""
        self.folder = Path(self.folder)
        require_folder(self.folder)
        if (self.folder / "config.json").is_file():
            raise version_one(self.folder / "config.json")

    def require_parts(self, chosen: str = AUTOMATIC) -> Bundle:
        """Raises CheckpointError when a render, with the chosen transformer, would not find what it needs."""
        require_parts(self.folder, chosen)
        return self

    def transformer(self, resolution: int, chosen: str = AUTOMATIC) -> RenderFormer:
        """The network for pictures whose longer side is `resolution` pixels; chosen: as of transformer_for."""
        return load_transformer(self.folder / transformer_for(self.folder, resolution, chosen))

    def mapper(self, name: str) -> Mapper:
        """"diffspec_mapper", "metallic_mapper" or "metallic_transmission_mapper"."""
        return load_component(MAPPERS[name], self.folder / name)

    def autoencoder(self) -> MaterialAutoencoder:
        folder = self.folder / "material_autoencoder"
        mode = read_json(require(folder, "preprocessor_config.json")).get("mode")
        if mode != "log10_1p":
            raise CheckpointError(f"{folder / 'preprocessor_config.json'}: mode {mode!r} is unknown, not 'log10_1p'")
        return load_component(MaterialAutoencoder, folder)


@checkpoint_errors()
def load_transformer(folder: Path) -> RenderFormer:
    """One transformer folder: model_config.json as it is saved by itself, or config.yaml, beside model.safetensors."""
    present = [name for name in TRANSFORMER if (folder / name).is_file()]
    if (folder / "config.json").is_file():
        if present:
            raise CheckpointError(f"{folder} holds both config.json and {present[0]}: it mixes two checkpoints")
        raise version_one(folder / "config.json")
    if present[:1] != [MODEL_CONFIG]:
        config = read_yaml_config(require(folder, (present or ["config.yaml"])[0]))
        return build_network(RenderFormer, config, weights_file(folder))
    file = folder / MODEL_CONFIG
    description = read_json(file)
    found = {key: description.get(key) for key in FORMAT}
    if found == FORMAT:
        return read_network(RenderFormer, folder, MODEL_CONFIG)
    if found != STANDALONE:
        raise CheckpointError(f"{file} is of an unknown format: expected {STANDALONE}, found {found}")
    return build_network(RenderFormer, _config(description, file), weights_file(folder))


def _config(content: dict, file: Path) -> ModelConfig:
    """`model_config` of what the file holds."""
    section = content.get("model_config")
    if not isinstance(section, dict):
        raise CheckpointError(f"{file} has no model_config section: expected a mapping, found "
                              f"{type(section).__name__}")
    try:
        return model_config(section)
    except CheckpointError as error:
        raise CheckpointError(f"{file}: {error}") from error


def read_yaml_config(file: Path) -> ModelConfig:
    """`model_config` of a published config.yaml, strict on unknown keys."""
    try:
        import yaml  # not part of Blender
    except ImportError as error:
        raise CheckpointError(f"PyYAML is needed to read {file}: install the packages for the published weights in the "
                              "add-on's preferences, or run `pip install pyyaml`") from error
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise CheckpointError(f"{file} cannot be read ({reason}): download or copy it again") from error
    if not isinstance(content, dict):
        raise CheckpointError(f"{file} has no model_config section: expected a mapping, found "
                              f"{type(content).__name__}")
    unknown = sorted(map(str, set(content) - SECTIONS))
    if unknown:
        raise CheckpointError(f"{file} has unknown sections: {', '.join(unknown)}; expected are "
                              f"{', '.join(sorted(SECTIONS))}")
    trainer = content.get("trainer_config") or {}
    if not isinstance(trainer, dict):
        raise CheckpointError(f"{file}: trainer_config is not a mapping")
    for name, value in RELEASED_TRAINER.items():
        if trainer.get(name, value) != value:
            raise CheckpointError(f"{file}: {name} = {trainer[name]!r} is not supported, only {value!r}")
    return _config(content, file)
