# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of the published bundle (docs/scene-input.md 12); this module does not import PyTorch."""
from __future__ import annotations

from pathlib import Path

INDEX = "model_index.json"
CONFIG = ("config.json",)
TRANSFORMER = ("config.yaml", "config.yml", "model_config.json")
COMPONENTS = {  # folder: names of which one describes it
    "transformer_512": TRANSFORMER, "transformer_2048": TRANSFORMER, "material_autoencoder": CONFIG,
    "diffspec_mapper": CONFIG, "metallic_mapper": CONFIG, "metallic_transmission_mapper": CONFIG,
}


def is_bundle(folder: str | Path) -> bool:
    """Whether the folder is a published bundle, or what a partial download left of it. Raises OSError."""
    return any((Path(folder) / name).exists() for name in (INDEX, *COMPONENTS))
