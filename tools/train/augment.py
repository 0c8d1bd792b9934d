# SPDX-License-Identifier: GPL-3.0-or-later
"""Symmetries of light transport: the picture does not change when the world turns, grows or its colours are swapped,
and becomes its mirror image when the world does.

The authors turn every sample about any axis, move it, and swap the environment's channels; so do published samples here
(published_samples.py), but the channels of everything that has a colour are swapped together. Other samples turn about
Z (the panorama is shifted, not resampled) and are mirrored and resized.
"""
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from renderformer_v2.model.environment import direction_map, sample_panorama
from renderformer_v2.model.fields import (
    COLOR,
    DIRECTION,
    EULER,
    PANORAMA,
    POINT,
    Behaviour,
    map_arrays,
    map_channels,
    map_layouts,
)
from renderformer_v2.model.geometry import contracted, euler_angles, rotation_matrix, uncontracted
from renderformer_v2.model.guided.features import OFFSET_SCALE, SURFACE
from renderformer_v2.model.light.direct.emitter_light import EMITTER
from renderformer_v2.model.scene import TILE

from .samples import CONFIG, TrainingSample

PATCH = CONFIG.patch_size
SIZES = 0.75, 1.25  # of the world, smallest and largest


def augment(sample: TrainingSample, generator: torch.Generator) -> TrainingSample:
    """A randomly turned, resized and recoloured copy, or its mirror image; textures stay BSDF parameters."""
    shift = int(torch.randint(sample.inputs.environment.ldr.shape[-1], (1,), generator=generator))
    sample = turned_and_swapped(sample, shift, torch.randperm(3, generator=generator))
    low, high = map(math.log, SIZES)
    sample = resized(sample, math.exp(low + (high - low) * float(torch.rand((), generator=generator))))
    return mirrored(sample) if torch.rand((), generator=generator) < 0.5 else sample


def resized(sample: TrainingSample, factor: float) -> TrainingSample:
    """The world, with its media and the distances of its cameras, so many times as large."""
    inputs, view = sample.inputs, sample.view
    volumes, offset = inputs.volumes, SURFACE["offset"]
    if volumes is not None:
        volumes = replace(volumes, position=_farther(volumes.position, factor), scale=volumes.scale * factor,
                          scattering=volumes.scattering / factor, absorption=volumes.absorption / factor)
    triangles = torch.where(inputs.is_light[:, None, None], inputs.triangles * factor,
                            _farther(inputs.triangles, factor))
    bundles = _farther(view.positions, factor)
    before, after = (_of_pixels(x, view.directions.shape[2]) for x in (view.positions, bundles))
    hits = _farther((before + view.surface[:, offset] / OFFSET_SCALE).movedim(1, -1), factor).movedim(-1, 1)
    surface = view.surface.clone()
    surface[:, offset] = (hits - after) * OFFSET_SCALE * (view.surface[:, SURFACE["alpha"]] > 0)
    nearness = view.emitters[:, :, EMITTER["nearness"]]
    emitters = view.emitters.clone()
    emitters[:, :, EMITTER["nearness"]] = nearness / (nearness + factor * (1 - nearness))
    return replace(sample, inputs=replace(inputs, triangles=triangles, volumes=volumes),
                   view=replace(view, origin=view.origin * factor, positions=bundles, surface=surface,
                                emitters=emitters))


def _farther(points: Tensor, factor: float) -> Tensor:
    """Points in contracted space, whose distance from the centre of the world is multiplied."""
    return contracted(uncontracted(points) * factor)


def _of_pixels(bundles: Tensor, width: int) -> Tensor:
    """(V, R, 3) of ray bundles -> (V, 3, H, W) of their pixels, W = width."""
    grid = bundles.unflatten(1, (-1, width // PATCH)).movedim(-1, 1)
    return grid.repeat_interleave(PATCH, 2).repeat_interleave(PATCH, 3)


def mirrored(sample: TrainingSample) -> TrainingSample:
    """The world with X reversed, seen by mirrored cameras, in pictures whose left is their right.

    Normals within tiles stay, whose tangents a mirror would reverse.
    """
    def reverse_x(vectors: Tensor) -> Tensor:
        return vectors * vectors.new_tensor([-1, 1, 1])

    # Column c of a panorama looks along phi = pi - 2 pi c / columns, and what was at phi is at pi - phi.
    changed = map_arrays(sample, {
        POINT: reverse_x, DIRECTION: reverse_x, EULER: lambda euler: euler * euler.new_tensor([1, -1, -1]),
        PANORAMA: lambda x: x.flip(-1).roll(x.shape[-1] // 2, -1)})
    volumes, view = changed.inputs.volumes, changed.view
    if volumes is not None:
        volumes = replace(volumes, density=volumes.density.unflatten(1, (4, 4, 4)).flip(-1).flatten(1))
    bundles = view.positions.unflatten(1, (-1, view.directions.shape[2] // PATCH)).flip(2).flatten(1, 2)
    inputs = replace(changed.inputs, volumes=volumes, sent=changed.inputs.sent.flip(1))  # front is back now
    changed = replace(changed, inputs=inputs, view=replace(view, positions=bundles))
    return map_layouts(changed, lambda x, layout: x.flip(layout.shape.index("W")) if "W" in layout.shape else x)


def turned_and_swapped(sample: TrainingSample, shift: int, order: Tensor) -> TrainingSample:
    """Turned by so many columns of the panorama, with the colour channels in this order."""
    changes = symmetry(shift / sample.inputs.environment.ldr.shape[-1], order)
    changed = map_arrays(sample, changes)
    tiles = map_channels(sample.inputs.texture, TILE, changes)
    return replace(changed, inputs=replace(changed.inputs, texture=tiles))


def symmetry(turns: float, order: Tensor) -> dict[Behaviour, Callable[[Tensor], Tensor]]:
    """Changes for `map_arrays`: turns about Z, by whole columns of panoramas, and the order of colour channels."""
    # Column c of a panorama looks along phi = pi - 2 pi c / columns: a turn by +angle moves it to the left.
    return turned(rotation(torch.tensor([0, 0, 2 * math.pi * turns]))) | {
        COLOR: recolored(order), PANORAMA: lambda x: x.roll(-round(turns * x.shape[-1]), -1)}


def rotation(vector: Tensor) -> Tensor:
    """(3, 3) f32 about the axis (3,) f32, by as many radians as it is long."""
    return torch.linalg.matrix_exp(torch.linalg.cross(vector.double().expand(3, 3), torch.eye(3).double()).T).float()


def turned(turn: Tensor) -> dict[Behaviour, Callable[[Tensor], Tensor]]:
    """Changes for `map_arrays`: the rotation (3, 3) f32 of all but panoramas."""
    def turn_euler(euler: Tensor) -> Tensor:
        distinct, index = np.unique(euler.numpy(), axis=0, return_inverse=True)  # the cells of a box share theirs
        angles = [euler_angles(turn.double().numpy() @ rotation_matrix(row)) for row in distinct]
        return torch.tensor(np.array(angles), dtype=euler.dtype)[torch.from_numpy(index.reshape(-1))]

    return {POINT: lambda x: x @ turn.T, DIRECTION: lambda x: x @ turn.T, EULER: turn_euler}


def resampled(turn: Tensor) -> Callable[[Tensor], Tensor]:
    """A function of panoramas (..., rows, 3, columns) f32 that turns them by the rotation (3, 3) f32."""
    def resample(x: Tensor) -> Tensor:
        directions = torch.from_numpy(direction_map(x.shape[-3], x.shape[-1])) @ turn
        maps = x.movedim(-1, -2).reshape(-1, *directions.shape).numpy()
        turned_maps = np.stack([sample_panorama(one, directions) for one in maps])
        return torch.from_numpy(turned_maps).movedim(-1, -2).reshape(x.shape)

    return resample


def for_numpy(changes: dict[Behaviour, Callable[[Tensor], Tensor]]) -> dict[Behaviour, Callable]:
    """The same changes of numpy arrays."""
    return {behaviour: lambda x, change=change: change(torch.from_numpy(np.ascontiguousarray(x))).numpy()
            for behaviour, change in changes.items()}


def recolored(order: Tensor) -> Callable[[Tensor], Tensor]:
    """A function of (..., 3 n) colours: their channels in this order."""
    return lambda x: x.unflatten(-1, (-1, 3)).index_select(-1, order).flatten(-2)
