# SPDX-License-Identifier: GPL-3.0-or-later
"""BSDF parameters -> 9-D latents with the three published mappers (docs/scene-input.md 3.2, 3.3)."""
from __future__ import annotations

import torch

from ..scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION
from .mappers import LATENT_DIM, Mapper

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
