# SPDX-License-Identifier: GPL-3.0-or-later
"""The appearance latent of a measured BRDF, by the bundled material autoencoder, and which mappers know it."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from ..weights.checkpoint import load_component
from ..weights.presets import WEIGHTS
from .adaptive_brdf import AdaptiveBRDF
from .autoencoder import MaterialAutoencoder, encode_picture
from .mappers import Mapper, load_material_mapper
from .measured import SUFFIXES, MeasuredBRDF, sphere_picture

AUTOENCODER = WEIGHTS / "material" / "material_autoencoder"
SIZE = 64         # pixels of its spheres
TOLERANCE = 0.02  # of latents, which half precision changes
MATERIALS = [[0.8, 0.2, 0.1, 0, 0.3, 1.5, 0], [0.5, 0.5, 0.5, 1, 0.1, 1.5, 0], [0.9, 0.9, 0.9, 0, 0.05, 1.4, 1]]


def load_brdf(path: Path) -> AdaptiveBRDF | MeasuredBRDF:
    """A file with one of SUFFIXES. Raises SceneError."""
    return (AdaptiveBRDF if path.suffix.lower() == SUFFIXES[0] else MeasuredBRDF).load(path)


def encode_brdf(path: Path, light: np.ndarray, autoencoder: Path = AUTOENCODER) -> tuple[np.ndarray, ...]:
    """Of a file's BRDF under a light (H, W), row 0 looking up: its latent (9,) f32, its sphere (64, 64, 3) f32 linear
    radiance, and what the autoencoder makes of it. Takes a minute, and reports progress.

    Raises SceneError for the file, CheckpointError for the autoencoder.
    """
    model, brdf = load_component(MaterialAutoencoder, autoencoder), load_brdf(path)
    picture = sphere_picture(brdf, light, SIZE)
    latent, decoded = encode_picture(model, picture)
    return latent, picture, decoded


def is_of_bundled_autoencoder(mapper: Mapper) -> bool:
    """Whether a mapper (of metals and glass) was trained with the bundled autoencoder, as the bundled mapper was."""
    materials = torch.tensor(MATERIALS)
    with torch.inference_mode():
        return bool(torch.allclose(mapper(materials).float(), load_material_mapper()(materials), atol=TOLERANCE))
