# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptrons from shader parameters to the 9-D appearance latent (docs/scene-input.md 3.1, docs/network.md 13)."""
from __future__ import annotations

from pathlib import Path

import torch
from torch import nn
from torch.nn import functional as F

from ..network.norm import Linear
from ..weights.checkpoint import load_component
from ..weights.presets import WEIGHTS

LATENT_DIM = 9
MATERIAL_MAPPER = WEIGHTS / "material" / "metallic_transmission_mapper"  # of the bundled weights


class Mapper(nn.Module):
    """Linear-ReLU-...-Linear-tanh on raw parameters, (..., inputs) -> (..., latent_dim) in (-1, 1)."""

    inputs: int

    def __init__(self, hidden_dim: int = 128, num_layers: int = 3, latent_dim: int = LATENT_DIM):
        super().__init__()
        if latent_dim != LATENT_DIM:
            raise ValueError(f"latent_dim = {latent_dim}, but appearance latents have {LATENT_DIM} channels")
        widths = [self.inputs, *[hidden_dim] * (num_layers - 1), latent_dim]
        self.layers = nn.ModuleList(Linear(a, b) for a, b in zip(widths, widths[1:]))

    def forward(self, parameters: torch.Tensor) -> torch.Tensor:
        x = parameters
        for layer in self.layers[:-1]:
            x = F.relu(layer(x))
        return torch.tanh(self.layers[-1](x))


class DiffuseSpecularMapper(Mapper):
    """Diffuse R, G, B; specular R, G, B; roughness."""

    inputs = 7


class MetallicMapper(Mapper):
    """Base R, G, B; metallic; roughness."""

    inputs = 5


class MetallicTransmissionMapper(Mapper):
    """Base R, G, B; metallic; roughness; index of refraction; transmission weight."""

    inputs = 7

    def __init__(self, hidden_dim: int = 256, num_layers: int = 5, latent_dim: int = LATENT_DIM):
        super().__init__(hidden_dim, num_layers, latent_dim)


MAPPERS = {"diffspec_mapper": DiffuseSpecularMapper, "metallic_mapper": MetallicMapper,
           "metallic_transmission_mapper": MetallicTransmissionMapper}


def load_material_mapper(folder: Path = MATERIAL_MAPPER) -> Mapper:
    """The bundled mapper from Principled parameters to the 9-D latent. Raises CheckpointError."""
    return load_component(MetallicTransmissionMapper, folder)
