# SPDX-License-Identifier: GPL-3.0-or-later
"""What the published bundle consists of (docs/scene-input.md 12); known without importing PyTorch."""
from __future__ import annotations

INDEX = "model_index.json"
CONFIG = ("config.json",)
TRANSFORMER = ("config.yaml", "config.yml", "model_config.json")
COMPONENTS = {  # folder: names of which one describes it
    "transformer_512": TRANSFORMER, "transformer_2048": TRANSFORMER, "material_autoencoder": CONFIG,
    "diffspec_mapper": CONFIG, "metallic_mapper": CONFIG, "metallic_transmission_mapper": CONFIG,
}
