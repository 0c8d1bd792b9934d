# SPDX-License-Identifier: GPL-3.0-or-later
"""RenderScene -> NetworkInputs: the last step from arrays to tensors."""
from __future__ import annotations

from dataclasses import fields

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from .environment import environment_images
from .guided.encoders import PANORAMA, TILE_SIDE
from .network.inputs import EnvironmentInputs, NetworkInputs, VolumeInputs, encode_light
from .scene import HEIGHT, NORMAL, RenderScene, Volumes

FARTHEST_LIGHT = 3.0  # network units; training lights are 2.1 to 2.7 away (spec/scene-input.md 1.2)


def small_inputs(scene: RenderScene, texture: Tensor) -> NetworkInputs:
    """Inputs of the bundled preset from a normalised scene and what stands for its T tiles (`material_tiles`)."""
    return NetworkInputs(
        triangles=torch.from_numpy(nearer_lights(scene)), normals=torch.from_numpy(scene.normals),
        texture=texture, texture_index=torch.from_numpy(scene.tile_index).long(),
        light=encode_light(torch.from_numpy(scene.emission)), environment=environment_inputs(scene.environment),
        volumes=volume_inputs(scene.volumes))


def nearer_lights(scene: RenderScene) -> np.ndarray:
    """(N, 3, 3) corners with far lights brought near: shrunk towards the centre, where they look the same as before."""
    distance = np.linalg.norm(scene.triangles.mean(axis=1), axis=1)
    shrink = np.where(scene.is_light, np.minimum(1, FARTHEST_LIGHT / np.maximum(distance, 1e-6)), 1)
    return (scene.triangles * shrink[:, None, None]).astype(np.float32)


def pooled_tiles(tiles: np.ndarray) -> Tensor:
    """(T, 11, 32, 32) -> (T, 11, 8, 8) area averages."""
    return F.adaptive_avg_pool2d(torch.from_numpy(tiles).float(), TILE_SIDE)


def material_tiles(pooled: Tensor, mapper) -> Tensor:
    """(T, 11, q, q) BSDF parameters, normal and height -> (T, 13, q, q) latents, normal and height.

    mapper: (P, 7) BSDF parameters -> (P, 9) latents.
    """
    parameters = pooled[:, : NORMAL.start].flatten(2).transpose(1, 2)  # (T, q^2, 7)
    constant = (parameters == parameters[:, :1]).all(2).all(1)
    with torch.no_grad():
        latents = mapper(parameters[:, :1]).expand(-1, parameters.shape[1], -1).clone()
        if not constant.all():
            latents[~constant] = mapper(parameters[~constant])
    latents = latents.transpose(1, 2).unflatten(2, pooled.shape[2:])
    return torch.cat([latents, pooled[:, NORMAL], pooled[:, HEIGHT : HEIGHT + 1]], 1)


def environment_inputs(radiance: np.ndarray | None) -> EnvironmentInputs:
    """Panoramas for the small encoder; a black one where there is no world, as in training."""
    if radiance is None:
        radiance = np.zeros((*PANORAMA, 3), np.float32)
    pooled = F.adaptive_avg_pool2d(torch.from_numpy(radiance).permute(2, 0, 1)[None], PANORAMA)[0]
    ldr, hdr, strength = environment_images(pooled.permute(1, 2, 0).numpy())
    return EnvironmentInputs(torch.from_numpy(ldr), torch.from_numpy(hdr), torch.tensor([strength]))


def volume_inputs(volumes: Volumes | None) -> VolumeInputs | None:
    if volumes is None or not len(volumes):
        return None
    return VolumeInputs(**{f.name: torch.from_numpy(getattr(volumes, f.name)) for f in fields(Volumes)})
