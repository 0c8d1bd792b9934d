# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the network: tensors of one scene and of its views (docs/network.md 2), and how a normalised RenderScene
becomes them.
"""
from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from ..camera import view_rays
from ..fields import COLOR, DIRECTION, EULER, LENGTH, PANORAMA, POINT, array
from ..scene import BASE_COLOR, HEIGHT, IOR, NORMAL, RenderScene, View, Volumes, constant_tile
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


LIGHT_TILE = constant_tile((1, 1, 1), roughness=1, ior=1)  # what every emitter was in training
FARTHEST_LIGHT = 3.0  # network units; training lights are 2.1 to 2.7 away (docs/scene-input.md 1.2)


def bring_lights_near(scene: RenderScene) -> np.ndarray:
    """(N, 3, 3) corners with far lights brought near: shrunk towards the centre, where they look the same as before."""
    distance = np.linalg.norm(scene.triangles.mean(axis=1), axis=1)
    shrink = np.where(scene.is_light, np.minimum(1, FARTHEST_LIGHT / np.maximum(distance, 1e-6)), 1)
    return (scene.triangles * shrink[:, None, None]).astype(np.float32)


def trained_tiles(scene: RenderScene) -> tuple[np.ndarray, np.ndarray]:
    """(T + 1, 11, 32, 32) tiles of a scene, and the row (N,) of each triangle: that of emitters is the last."""
    tiles = np.concatenate([scene.tiles, LIGHT_TILE[None]])
    return tiles, np.where(scene.is_light, len(scene.tiles), scene.tile_index)


def material_tiles(pooled: Tensor, mapper) -> Tensor:
    """(T, 11, q, q) BSDF parameters, normal and height -> (T, 13, q, q) latents, normal and height.

    mapper: (P, 7) BSDF parameters -> (P, 9) latents.
    """
    parameters = pooled[:, : NORMAL.start].clone()
    parameters[:, BASE_COLOR].clamp_(max=1)  # no mapper was trained with more,
    parameters[:, IOR].clamp_(min=1)         # or with less
    parameters = parameters.flatten(2).transpose(1, 2)  # (T, q^2, 7)
    constant = (parameters == parameters[:, :1]).all(2).all(1)
    with torch.no_grad():
        latents = mapper(parameters[:, :1]).expand(-1, parameters.shape[1], -1).clone()
        if not constant.all():
            latents[~constant] = mapper(parameters[~constant])
    latents = latents.transpose(1, 2).unflatten(2, pooled.shape[2:])
    return torch.cat([latents, pooled[:, NORMAL], pooled[:, HEIGHT : HEIGHT + 1]], 1)


def volume_inputs(volumes: Volumes | None) -> VolumeInputs | None:
    if not volumes:
        return None
    return VolumeInputs(**{f.name: torch.from_numpy(getattr(volumes, f.name)) for f in fields(Volumes)})


def view_inputs(*views: View) -> ViewInputs:
    """Cameras and rays of normalised views, all of one size."""
    return ViewInputs(*(torch.from_numpy(np.stack(x)) for x in zip(*map(view_rays, views))))
