# SPDX-License-Identifier: GPL-3.0-or-later
"""Symmetries of light transport: the picture does not change when the world turns or its colours are swapped.

The paper turns and moves every sample at random and swaps the environment's channels; here the world turns about Z (the
panorama is shifted, not resampled) and the channels of everything that has a colour are swapped together.
"""
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from renderformer_v2.model.fields import COLOR, DIRECTION, EULER, PANORAMA, POINT, Behaviour, map_arrays, map_channels
from renderformer_v2.model.scene import TILE

from .samples import TrainingSample


def augment(sample: TrainingSample, generator: torch.Generator) -> TrainingSample:
    """A randomly turned and recoloured copy; textures stay BSDF parameters."""
    shift = int(torch.randint(sample.inputs.environment.ldr.shape[-1], (1,), generator=generator))
    return turned_and_swapped(sample, shift, torch.randperm(3, generator=generator))


def turned_and_swapped(sample: TrainingSample, shift: int, order: Tensor) -> TrainingSample:
    """Turned by so many columns of the panorama, with the colour channels in this order."""
    changes = symmetry(shift / sample.inputs.environment.ldr.shape[-1], order)
    changed = map_arrays(sample, changes)
    tiles = map_channels(sample.inputs.texture, TILE, changes)
    return replace(changed, inputs=replace(changed.inputs, texture=tiles))


def symmetry(turns: float, order: Tensor) -> dict[Behaviour, Callable[[Tensor], Tensor]]:
    """Changes for `map_arrays`: turns about Z, by whole columns of panoramas, and the order of colour channels."""
    angle = 2 * math.pi * turns
    turn = turn_about_z(angle)

    def add_turn(euler: Tensor) -> Tensor:
        """Rz(angle) Rz(z) Ry(y) Rx(x): turning about Z only adds to the last angle."""
        z = euler[..., 2] + angle
        return torch.cat([euler[..., :2], torch.atan2(z.sin(), z.cos())[..., None]], -1)

    # Column c of a panorama looks along phi = pi - 2 pi c / columns: a turn by +angle moves it to the left.
    return {POINT: turn, DIRECTION: turn, EULER: add_turn, COLOR: recolored(order),
            PANORAMA: lambda x: x.roll(-round(turns * x.shape[-1]), -1)}


def for_numpy(changes: dict[Behaviour, Callable[[Tensor], Tensor]]) -> dict[Behaviour, Callable]:
    """The same changes of numpy arrays."""
    return {behaviour: lambda x, change=change: change(torch.from_numpy(np.ascontiguousarray(x))).numpy()
            for behaviour, change in changes.items()}


def turn_about_z(angle: float) -> Callable[[Tensor], Tensor]:
    """A function of (..., 3) vectors."""
    c, s = math.cos(angle), math.sin(angle)
    matrix = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return lambda x: x @ matrix.T


def recolored(order: Tensor) -> Callable[[Tensor], Tensor]:
    """A function of (..., 3 n) colours: their channels in this order."""
    return lambda x: x.unflatten(-1, (-1, 3))[..., order].flatten(-2)
