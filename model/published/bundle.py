# SPDX-License-Identifier: GPL-3.0-or-later
"""The published bundle: two transformers, three mappers and the material autoencoder (docs/scene-input.md 12)."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..checkpoint import build_network, load_component, load_network
from ..errors import CheckpointError
from ..material.autoencoder import MaterialAutoencoder
from ..material.mappers import MAPPERS, Mapper
from ..network.config import ModelConfig
from ..network.renderformer import RenderFormer
from ..weights_files import explained, read_json, require, weights_file
from .bundle_files import INDEX, TRANSFORMER
from .model_config import model_config

LARGE_RESOLUTION = 2048  # pixels from which the second transformer is used
SECTIONS = {"model_config", "dataset_config", "trainer_config"}
# Trainer switches that change what the network is fed or returns; this implementation has the released position.
RELEASED_TRAINER = {"turn_to_cam_coord": False, "learn_ldr": False, "emission_area_encoding": False,
                    "clamped_hdr": False}


@dataclass
class Bundle:
    """A folder with `model_index.json`; its parts are read when they are asked for."""

    folder: Path

    @explained()
    def __post_init__(self) -> None:
        """Raises CheckpointError when the folder is not a published bundle."""
        self.folder = Path(self.folder)
        if (self.folder / "config.json").is_file() and not (self.folder / INDEX).is_file():
            raise CheckpointError(f"{self.folder} looks like a RenderFormer-V1 checkpoint, which cannot be used: "
                                  "choose the folder of renderformer-v2")
        read_json(require(self.folder, INDEX))

    def transformer(self, resolution: int) -> RenderFormer:
        """The network for pictures whose longer side is `resolution` pixels."""
        return load_transformer(self.folder / transformer_name(resolution))

    def mapper(self, name: str) -> Mapper:
        """"diffspec_mapper", "metallic_mapper" or "metallic_transmission_mapper"."""
        return load_component(MAPPERS[name], self.folder / name)

    def autoencoder(self) -> MaterialAutoencoder:
        folder = self.folder / "material_autoencoder"
        mode = read_json(require(folder, "preprocessor_config.json")).get("mode")
        if mode != "log10_1p":
            raise CheckpointError(f"{folder / 'preprocessor_config.json'}: mode {mode!r} is unknown, not 'log10_1p'")
        return load_component(MaterialAutoencoder, folder)


def transformer_name(resolution: int) -> str:
    """The bundle's folder with the network for pictures whose longer side is `resolution` pixels."""
    return "transformer_2048" if resolution >= LARGE_RESOLUTION else "transformer_512"


@explained()
def load_transformer(folder: Path) -> RenderFormer:
    """One transformer folder: config.yaml, or the standalone model_config.json, beside model.safetensors."""
    present = [name for name in TRANSFORMER if (folder / name).is_file()]
    if (folder / "config.json").is_file():
        if present:
            raise CheckpointError(f"{folder} holds both config.json and {present[0]}: it mixes two checkpoints")
        raise CheckpointError(f"{folder} holds a RenderFormer-V1 checkpoint (config.json), which cannot be used")
    if present == ["model_config.json"]:
        return load_network(folder, "model_config.json")
    return build_network(read_yaml_config(require(folder, (present or ["config.yaml"])[0])), weights_file(folder))


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
    if not isinstance(content, dict) or not isinstance(content.get("model_config"), dict):
        raise CheckpointError(f"{file} has no model_config section")
    unknown = sorted(set(content) - SECTIONS)
    if unknown:
        raise CheckpointError(f"{file} has unknown sections: {', '.join(unknown)}")
    trainer = content.get("trainer_config") or {}
    if not isinstance(trainer, dict):
        raise CheckpointError(f"{file}: trainer_config is not a mapping")
    for name, value in RELEASED_TRAINER.items():
        if trainer.get(name, value) != value:
            raise CheckpointError(f"{file}: {name} = {trainer[name]!r} is not supported, only {value!r}")
    return model_config(content["model_config"])
