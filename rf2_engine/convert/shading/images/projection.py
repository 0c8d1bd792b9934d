# SPDX-License-Identifier: GPL-3.0-or-later
"""Projections of Image Texture: flat, sphere, tube and box."""
from __future__ import annotations

import numpy as np

from ..arrays import divided, joined, length


def on_ball(vector: np.ndarray) -> np.ndarray:
    """(..., 2) of coordinates (..., 3) in a box from 0 to 1."""
    way = 2 * vector - 1
    size = length(way)
    return joined(_around(way), 1 - np.arccos(np.clip(divided(way[..., 2:], size), -1, 1)) / np.pi)


def on_tube(vector: np.ndarray) -> np.ndarray:
    way = 2 * vector - 1
    return joined(_around(way), (way[..., 2:] + 1) / 2) * (np.hypot(way[..., :1], way[..., 1:2]) > 0)


def _around(way: np.ndarray) -> np.ndarray:
    x, y = way[..., :1], way[..., 1:2]
    return np.where((x == 0) & (y == 0), 0, (1 - np.arctan2(x, y) / np.pi) / 2)


def on_box(vector: np.ndarray, normal: np.ndarray) -> list[np.ndarray]:
    """(..., 2) each, for the sides along x, y and z, of the object's normal (..., 3)."""
    x, y, z = np.split(vector, 3, axis=-1)
    nx, ny, nz = np.split(normal, 3, axis=-1)
    return [joined(np.where(nx < 0, 1 - y, y), z), joined(np.where(ny > 0, 1 - x, x), z),
            joined(np.where(nz > 0, 1 - y, y), x)]


def box_weights(normal: np.ndarray, blend: float) -> np.ndarray:
    """(..., 3) how much each side of a box shows where the surface has this normal."""
    size = np.abs(normal)
    size = divided(size, size.sum(axis=-1, keepdims=True))
    limit = (1 + blend) / 2
    weights = np.zeros_like(size)
    left = np.ones(size.shape[:-1], bool)
    for axis in range(3):  # one side alone
        others = [size[..., other] for other in range(3) if other != axis]
        alone = left & np.logical_and(*(size[..., axis] > limit * (size[..., axis] + other) for other in others))
        weights[alone, axis] = 1
        left &= ~alone
    if blend == 0:
        weights[left, 0] = 1
        return weights
    for last, first, second in ((2, 0, 1), (0, 1, 2), (1, 0, 2)):  # two sides
        pair = size[..., first] + size[..., second]
        both = left & (size[..., last] < (1 - limit) * pair)
        share = np.clip((divided(size[..., first], pair) - (1 - blend) / 2) / blend, 0, 1)
        weights[both, first], weights[both, second] = share[both], 1 - share[both]
        left &= ~both
    weights[left] = ((2 - limit) * size[left] + (limit - 1)) / (2 * limit - 1)
    return weights
