# SPDX-License-Identifier: GPL-3.0-or-later
"""Symmetries of light transport: the picture does not change when the world turns or its colours are swapped.

The paper turns every sample by a random rotation and swaps the environment's channels; here the world turns about Z
(the panorama is shifted, not resampled) and the channels of everything that has a colour are swapped together.
"""
from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from renderformer_v2.model.guided.guides import COLORS, LIGHT, MIRRORED, NORMAL, OFFSET
from renderformer_v2.model.scene import BASE_COLOR

from .samples import TrainingSample


def augment(sample: TrainingSample, generator: torch.Generator) -> TrainingSample:
    """A randomly turned and recoloured copy."""
    columns = sample.inputs.environment.ldr.shape[-1]
    shift = int(torch.randint(columns, (1,), generator=generator))
    order = torch.randperm(3, generator=generator)
    return _turn(_recolor(sample, order), shift, columns)


def _turn(sample: TrainingSample, shift: int, columns: int) -> TrainingSample:
    angle = 2 * math.pi * shift / columns
    c, s = math.cos(angle), math.sin(angle)
    matrix = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    turn = lambda x: x @ matrix.T  # noqa: E731
    inputs, guides = sample.inputs, sample.guides
    # Column c of the panorama looks along phi = pi - 2 pi c / columns: a turn by +angle moves it to the left.
    environment = replace(inputs.environment, ldr=inputs.environment.ldr.roll(-shift, -1),
                          hdr=inputs.environment.hdr.roll(-shift, -1))
    volumes = inputs.volumes
    if volumes is not None:
        # Rz(angle) Rz(z) Ry(y) Rx(x): turning about Z only adds to the last Euler angle.
        z = volumes.rotation[:, 2] + angle
        rotation = torch.cat([volumes.rotation[:, :2], torch.atan2(z.sin(), z.cos())[:, None]], 1)
        volumes = replace(volumes, position=turn(volumes.position), rotation=rotation)
    features = guides.features.clone()
    for part in (OFFSET, NORMAL, MIRRORED):
        features[:, part] = torch.einsum("ij,vjhw->vihw", matrix, guides.features[:, part])
    return replace(
        sample, beam_axis=turn(sample.beam_axis), rays_o=turn(sample.rays_o), rays_d=turn(sample.rays_d),
        inputs=replace(inputs, triangles=turn(inputs.triangles), normals=turn(inputs.normals), environment=environment,
                       volumes=volumes),
        guides=replace(guides, features=features, positions=turn(guides.positions)))


def _recolor(sample: TrainingSample, order: Tensor) -> TrainingSample:
    """Swap the channels of lights, materials, media, guides and references alike."""
    inputs, guides = sample.inputs, sample.guides
    environment = replace(inputs.environment, ldr=inputs.environment.ldr[order], hdr=inputs.environment.hdr[order])
    volumes = inputs.volumes
    if volumes is not None:
        volumes = replace(volumes, scattering=volumes.scattering[:, order], absorption=volumes.absorption[:, order])
    tiles, features = inputs.texture.clone(), guides.features.clone()
    tiles[:, BASE_COLOR] = inputs.texture[:, BASE_COLOR][:, order]
    for part in (COLORS, LIGHT):
        lobes = guides.features[:, part].unflatten(1, (3, 3))
        features[:, part] = lobes[:, :, order].flatten(1, 2)
    return replace(
        sample,
        inputs=replace(inputs, texture=tiles, light=inputs.light[:, order], environment=environment, volumes=volumes),
        guides=replace(guides, features=features, colors=guides.colors[:, :, order], prior=guides.prior[:, :, order]),
        image=sample.image[:, order], direct=sample.direct[:, :, order], indirect=sample.indirect[:, :, order])
