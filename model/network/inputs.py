# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the network: tensors of one scene and of its views (docs/network.md 2), on the model's device."""
from __future__ import annotations

from dataclasses import dataclass

import torch

from ..fields import COLOR, DIRECTION, EULER, LENGTH, PANORAMA, POINT, array
from ..tensor_group import TensorGroup


@dataclass
class VolumeInputs(TensorGroup):
    """M volume cells, masked rows already removed; all float32."""

    density: torch.Tensor = array("M", 64)
    position: torch.Tensor = array("M", 3, behaves=POINT)
    rotation: torch.Tensor = array("M", 3, behaves=EULER)  # radians
    scale: torch.Tensor = array("M", 3, behaves=LENGTH)
    scattering: torch.Tensor = array("M", 3, behaves=COLOR)
    absorption: torch.Tensor = array("M", 3, behaves=COLOR)


@dataclass
class EnvironmentInputs(TensorGroup):
    """LDR and HDR latents, or the images themselves for a network with its own encoder (docs/scene-input.md 7.4)."""

    ldr: torch.Tensor = array("C", "rows", "columns", behaves={COLOR: 0, PANORAMA: -1})  # latents, or a (3, ...) image
    hdr: torch.Tensor = array("C", "rows", "columns", behaves={COLOR: 0, PANORAMA: -1})
    strength: torch.Tensor = array(1)  # maximum of log10(1 + radiance)


@dataclass
class NetworkInputs(TensorGroup):
    """N triangles that share T distinct textures."""

    triangles: torch.Tensor = array("N", 3, 3, behaves=POINT)    # float32
    normals: torch.Tensor = array("N", 3, 3, behaves=DIRECTION)  # float32, unit
    texture: torch.Tensor = array("T", "C", "q", "q")  # latents, or material tiles for a network with its own encoder
    texture_index: torch.Tensor = array("N")           # int64, row of `texture`
    light: torch.Tensor = array("N", 3, behaves=COLOR)  # float32, log10(1 + radiance); any component > 0 makes a light
    environment: EnvironmentInputs | None = None
    volumes: VolumeInputs | None = None

    @property
    def is_light(self) -> torch.Tensor:
        """(N,) bool."""
        return (self.light > 0).any(dim=-1)


@dataclass
class ViewInputs(TensorGroup):
    """V cameras and the rays of their pixels; sides are multiples of `ModelConfig.granularity`."""

    origin: torch.Tensor = array("V", 3, behaves=POINT)                      # float32
    directions: torch.Tensor = array("V", "H", "W", 3, behaves=DIRECTION)    # float32, unit, row 0 on top


def encode_light(radiance: torch.Tensor) -> torch.Tensor:
    """Radiance -> log10(1 + max(radiance, 0)), float32 (docs/network.md 2)."""
    return torch.log10(radiance.float().clamp(min=0) + 1)
