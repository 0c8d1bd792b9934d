# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the guided transformer for a scene, for F12 and for training alike (those for views: features.py)."""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..beams import smoothed
from ..environment import environment_images
from ..fields import COLOR, DIRECTION, array
from ..geometry import area_vectors, contracted, unit
from ..light.bounce.patches import tile_albedo
from ..light.direct.direct_light import DirectLight, Visibility
from ..network.config import ModelConfig
from ..network.inputs import (
    EnvironmentInputs,
    NetworkInputs,
    VolumeInputs,
    bring_lights_near,
    encode_light,
    material_tiles,
    trained_tiles,
    volume_inputs,
)
from ..scene import RenderScene, Volumes
from .encoders import panorama_size, tile_side


@dataclass(kw_only=True)
class GuidedInputs(NetworkInputs):
    """A scene whose texture and environment are not encoded yet: (T, 13, t, t) material tiles, (3, h, w) images."""

    beam_axis: Tensor = array("L", 3, behaves=DIRECTION)  # of the light triangles, in input order
    beam_cosine: Tensor = array("L", 2)
    sent: Tensor = array("N", 2, 3, behaves=COLOR)  # radiance that front and back of a triangle send on; 0 with rays


def guided_inputs(scene: RenderScene, config: ModelConfig, mapper=None,
                  direct: DirectLight | None = None) -> GuidedInputs:
    """Tensors of a normalised scene on the CPU.

    mapper: (P, 7) BSDF parameters -> (P, 9) latents; without one the texture stays (T, 11, t, t) parameters, which
    `material_tiles` maps later. direct: the scene's light, of which it is told what triangles send on, as if nothing
    were in the way of emitters and sky; not given where rays find that and more.
    """
    tiles, tile_index = trained_tiles(scene)
    tiles = F.adaptive_avg_pool2d(torch.from_numpy(tiles).float(), tile_side(config))
    emission, borders = smoothed(scene.emission, scene.beam_cosine)
    light = encode_light(torch.from_numpy(emission))
    is_light = (light > 0).any(dim=-1).numpy()  # the very faint ones are none for the network
    return GuidedInputs(
        triangles=torch.from_numpy(_contracted_corners(scene)), normals=torch.from_numpy(scene.normals),
        texture=tiles if mapper is None else material_tiles(tiles, mapper),
        texture_index=torch.from_numpy(tile_index).long(), light=light,
        environment=_environment(scene.environment, panorama_size(config)), volumes=_volumes(scene.volumes),
        beam_axis=torch.from_numpy(scene.beam_axis[is_light]),
        beam_cosine=torch.from_numpy(borders[is_light]),
        sent=torch.zeros(len(scene), 2, 3) if direct is None else _sent(scene, direct).cpu())


def _contracted_corners(scene: RenderScene) -> np.ndarray:
    """(N, 3, 3) corners in contracted space: a large ground or a sky dome is like nothing in training."""
    lights = scene.is_light[:, None, None]
    return np.where(lights, bring_lights_near(scene), contracted(scene.triangles)).astype(np.float32)


def _sent(scene: RenderScene, direct: DirectLight) -> Tensor:
    """(N, 2, 3) light that the two sides of triangles send on, of emitters and sky without shadows."""
    center, normal = (torch.from_numpy(x).to(direct.device).repeat(2, 1) for x in (
        scene.triangles.mean(1), unit(area_vectors(scene.triangles))))
    normal[len(scene):] *= -1
    everything = torch.ones_like(center)
    light = direct.diffuse(center, normal, Visibility(everything, everything)).unflatten(0, (2, -1)).transpose(0, 1)
    albedo = tile_albedo(scene.tiles.mean(axis=(2, 3), dtype=np.float32), scene.of_tiles("single"))
    albedo = albedo.reshape(-1, 3, 3).sum(1)
    sides = np.stack([albedo[scene.tile_index], albedo[scene.tile_behind]], axis=1)
    return light * torch.from_numpy(sides).to(light)


def _volumes(volumes: Volumes | None) -> VolumeInputs | None:
    return volume_inputs(volumes and replace(volumes, position=contracted(volumes.position)))


def _environment(radiance: np.ndarray | None, size: tuple[int, int]) -> EnvironmentInputs:
    """LDR and HDR images; black ones where there is no world, as in training."""
    if radiance is None:
        radiance = np.zeros((*size, 3), np.float32)
    pooled = F.adaptive_avg_pool2d(torch.from_numpy(radiance).permute(2, 0, 1)[None], size)[0]
    ldr, hdr, strength = environment_images(pooled.permute(1, 2, 0).numpy())
    return EnvironmentInputs(torch.from_numpy(ldr), torch.from_numpy(hdr), torch.tensor([strength]))
