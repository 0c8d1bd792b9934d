# SPDX-License-Identifier: GPL-3.0-or-later
"""Tiles of surfaces: parameters over the texels of a triangle as the arrays of a RenderScene, and their means."""
from __future__ import annotations

from dataclasses import fields

import numpy as np

from ....model.scene import (
    BASE_COLOR,
    EMISSION_SIZE,
    HEIGHT,
    IOR,
    METALLIC,
    NORMAL,
    ROUGHNESS,
    TILE_CHANNELS,
    TILE_SIZE,
    TRANSMISSION,
    TWO_LOBES,
    cells_inside,
)
from .closure import SurfaceParameters

LEAST_SOLID = 1e-3           # share of a cell that counts, at least: the mean of what is clear everywhere is not 0 / 0
INSIDE, INSIDE_FINE = cells_inside(), cells_inside(EMISSION_SIZE)
QUARTERS = np.float32([  # weights of corners at those of the quarters of a triangle, so that their texels are its own
    [(2, 0, 0), (1, 1, 0), (1, 0, 1)], [(1, 1, 0), (0, 2, 0), (0, 1, 1)], [(1, 0, 1), (0, 1, 1), (0, 0, 2)],
    [(0, 1, 1), (1, 0, 1), (1, 1, 0)]]) / 2


def is_homogeneous(surface: SurfaceParameters) -> bool:
    """Whether it is the same at all points."""
    return all(getattr(surface, f.name).ndim == 1 for f in fields(surface))


def bsdf_parameters(surface: SurfaceParameters) -> tuple[tuple[int | slice, np.ndarray], ...]:
    """Values by their channels of a tile."""
    return ((BASE_COLOR, surface.base_color), (METALLIC, surface.metallic), (ROUGHNESS, surface.roughness),
            (IOR, surface.ior), (TRANSMISSION, surface.transmission))


def tile_arrays(surface: SurfaceParameters, height: np.ndarray) -> np.ndarray:
    """(m, 11, 32, 32) f16, m = 1 when no parameter varies over the surface."""
    placed = (*bsdf_parameters(surface), (NORMAL, surface.normal), (HEIGHT, height))
    count = max(len(values) if values.ndim > 1 else 1 for _, values in placed)
    tiles = np.empty((count, TILE_CHANNELS, TILE_SIZE, TILE_SIZE), np.float16)
    for channel, values in placed:
        channels = slice(channel, channel + 1) if isinstance(channel, int) else channel
        full = np.broadcast_to(values, (count, TILE_SIZE, TILE_SIZE, values.shape[-1]))
        tiles[:, channels] = np.moveaxis(full, -1, 1)
    return tiles


def lobe_arrays(lobes: dict[str, np.ndarray], count: int) -> np.ndarray:
    """(m, 7, 32, 32) f16 of the result of `two_lobes`, m = `count` of tiles if nothing varies over the surface."""
    named = {name: lobes[name] for name in TWO_LOBES.parts}
    count = max([count] + [len(values) for values in named.values() if values.ndim > 1])
    arrays = np.empty((count, len(TWO_LOBES), TILE_SIZE, TILE_SIZE), np.float16)
    for name, values in named.items():
        full = np.broadcast_to(values, (count, TILE_SIZE, TILE_SIZE, values.shape[-1]))
        arrays[:, TWO_LOBES[name]] = np.moveaxis(full, -1, 1)
    return arrays


def join_quarters(first: np.ndarray, second: np.ndarray, third: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """(m, 64, 64, 3) values on triangles of those (m, 32, 32, 3) on their QUARTERS.

    Those at the borders are of the texels before: at the very edge of an image its other edge begins.
    """
    fine = np.zeros((len(first), EMISSION_SIZE, EMISSION_SIZE, 3), np.float32)
    fine[:, :TILE_SIZE, TILE_SIZE:], fine[:, TILE_SIZE:, :TILE_SIZE] = first, second
    fine[:, :TILE_SIZE, :TILE_SIZE] = np.where(INSIDE[..., None], third, middle[:, ::-1, ::-1])
    row = np.arange(EMISSION_SIZE)
    column = row[::-1]
    fine[:, row, column] = fine[:, row - (row > column), column - (row < column)]
    fine[:, 0], fine[:, :, 0] = fine[:, 1], fine[:, :, 1]
    fine[:, 0, -1], fine[:, -1, 0] = fine[:, 0, -2], fine[:, -2, 0]
    return fine


def mean_over_triangle(values: np.ndarray) -> np.ndarray:
    """(c,) or (m, 32, 32, c) -> (c,) or (m, c): mean over the cells inside the triangle. (m, 1, 1, c): it is even."""
    if values.ndim == 1:
        return values
    if values.shape[1:3] == (1, 1):
        return values[:, 0, 0]
    return values[:, INSIDE].mean(axis=1)


def mean_of_solid(values: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """The same of a surface of which a share, values (3,) or (m, 32, 32, 3), is `clear`: by how much of it is there."""
    if values.ndim == 1 or clear.ndim == 1:
        return mean_over_triangle(values)
    solid = (1 - clear.mean(axis=-1, keepdims=True)).clip(LEAST_SOLID)
    return mean_over_triangle(values * solid) / mean_over_triangle(solid)
