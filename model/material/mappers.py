# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptrons from shader parameters to the 9-D appearance latent, and the choice of one for every texel
(docs/scene-input.md 3.1 to 3.3, docs/network.md 13).
"""
from __future__ import annotations

from pathlib import Path

import torch
from torch import nn
from torch.nn import functional as F

from ..network.layers import Linear
from ..scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION
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


PAPER_IOR = 1.5  # at Specular IOR Level 1: what the metallic mapper and its training renders mean by "not metal"


class Appearance:
    """Chooses for every texel the mapper that was trained on its kind of material.

    - Opaque without specular reflection (not metallic, effective IOR 1), which is also what emitters are: diffspec with
      no specular; roughness 1, because that of a lobe that is not there must not matter.
    - Opaque metal, or a dielectric of IOR 1.5: the metallic mapper, as in the training scenes.
    - All else: the transmission mapper, which knows the index of refraction.
    """

    def __init__(self, diffuse_specular: Mapper, metallic: Mapper, transmission: Mapper):
        self.diffuse_specular, self.metallic, self.transmission = diffuse_specular, metallic, transmission

    @property
    def mappers(self) -> tuple[Mapper, Mapper, Mapper]:
        return self.diffuse_specular, self.metallic, self.transmission

    def __call__(self, parameters: torch.Tensor) -> torch.Tensor:
        """(..., 7) base RGB, metallic, roughness, effective IOR, transmission -> (..., 9) in (-1, 1)."""
        p = parameters.reshape(-1, parameters.shape[-1])
        opaque = p[:, TRANSMISSION] == 0
        matt = opaque & (p[:, METALLIC] == 0) & (p[:, IOR] == 1)
        paper = opaque & ~matt & ((p[:, IOR] == PAPER_IOR) | (p[:, METALLIC] == 1))
        latents = p.new_empty(len(p), LATENT_DIM)
        for rows, latent in ((matt, self._matt), (paper, self._paper), (~matt & ~paper, self.transmission)):
            if rows.any():
                latents[rows] = latent(p[rows])
        return latents.view(*parameters.shape[:-1], LATENT_DIM)

    def _matt(self, p: torch.Tensor) -> torch.Tensor:
        specular, roughness = p.new_zeros(len(p), 3), p.new_ones(len(p), 1)
        return self.diffuse_specular(torch.cat([p[:, BASE_COLOR], specular, roughness], 1))

    def _paper(self, p: torch.Tensor) -> torch.Tensor:
        return self.metallic(p[:, : ROUGHNESS + 1])
