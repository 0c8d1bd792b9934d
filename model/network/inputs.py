# SPDX-License-Identifier: GPL-3.0-or-later
"""What the network is given: tensors of one scene (spec/network.md 2), on the model's device."""
from __future__ import annotations

from dataclasses import dataclass, fields

import torch


class TensorGroup:
    """Base of dataclasses whose fields are tensors, other groups, or None."""

    def to(self, device):
        """A copy on `device`."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return type(self)(**{name: v if v is None else v.to(device) for name, v in values.items()})


@dataclass
class VolumeInputs(TensorGroup):
    """M volume cells, masked rows already removed; all float32."""

    density: torch.Tensor     # (M, 64)
    position: torch.Tensor    # (M, 3)
    rotation: torch.Tensor    # (M, 3) radians
    scale: torch.Tensor       # (M, 3)
    scattering: torch.Tensor  # (M, 3)
    absorption: torch.Tensor  # (M, 3)


@dataclass
class EnvironmentInputs(TensorGroup):
    """LDR and HDR latents, or the images themselves for a network with its own encoder (spec/scene-input.md 7.4)."""

    ldr: torch.Tensor       # (C, 32, 64) latents or (3, 64, 128) image
    hdr: torch.Tensor       # same
    strength: torch.Tensor  # (1,) maximum of log10(1 + radiance)


@dataclass
class NetworkInputs(TensorGroup):
    """N triangles that share T distinct textures."""

    triangles: torch.Tensor      # (N, 3, 3) float32
    normals: torch.Tensor        # (N, 3, 3) float32, unit
    texture: torch.Tensor        # (T, C, q, q) latents, or (T, 13, 8, 8) for a network with its own tile encoder
    texture_index: torch.Tensor  # (N,) int64, row of `texture`
    light: torch.Tensor          # (N, 3) float32, log10(1 + radiance); any component > 0 makes a light
    environment: EnvironmentInputs | None = None
    volumes: VolumeInputs | None = None

    @property
    def is_light(self) -> torch.Tensor:
        """(N,) bool."""
        return (self.light > 0).any(dim=-1)


def encode_light(radiance: torch.Tensor) -> torch.Tensor:
    """Radiance -> log10(1 + max(radiance, 0)), float32 (spec/network.md 2)."""
    return torch.log10(radiance.float().clamp(min=0) + 1)
