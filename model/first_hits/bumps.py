# SPDX-License-Identifier: GPL-3.0-or-later
"""Bumps finer than a pixel: the mean of its normals is nearly that of a smooth surface, but the light that they mirror
spreads as if that were rougher (Toksvig 2005), and matte ones send on less light."""
from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..geometry import dot, unit
from ..material.reflectance import widened

LEAST = 1e-4  # variance of normals that widens no lobe
EVEN = 0.3    # largest slope of the way to the next pixel, from the surface, where that goes on
PIXELS = 1 << 16  # whose surroundings are looked at together


def normal_variance(mean: np.ndarray, samples: np.ndarray | None, position: np.ndarray,
                    geometry: np.ndarray) -> np.ndarray | None:
    """(H, W) f32 mean square by which normals differ in a pixel from their mean, beyond what is seen of it.

    mean: (H, W, 3), of the unit normals of `samples` (H, W); position and geometry: (H, W, 3), in the middle of pixels,
    and unit normals without bumps there; 0 = no hit. 0 where other surfaces are near. None where there are no bumps.
    """
    variance = _variance(mean, samples)
    for pixel in _uneven(variance):
        steps = _steps_around(geometry, pixel)
        # Two surfaces that share a pixel differ from their mean by half of their difference at most.
        explained = np.maximum(_largest2(steps), _largest2(_steps_around(mean, pixel, unit))) / 4
        goes_on = _goes_on(_steps_around(position, pixel), geometry.reshape(-1, 3)[pixel], steps)
        variance.flat[pixel] = np.where(goes_on, variance.flat[pixel] - explained, 0)
    variance = np.where(variance > LEAST, variance, 0).clip(max=1).astype(np.float32)
    return variance if variance.any() else None


def with_bumps(roughness: np.ndarray, variance: np.ndarray | None) -> np.ndarray:
    """(H, W) roughness of lobes as wide as those of all bumps of a pixel together."""
    return roughness if variance is None else widened(roughness, variance).clip(max=1)


def matte_share(mean: np.ndarray, samples: np.ndarray | None, geometry: np.ndarray) -> np.ndarray | None:
    """(H, W) f32 share of a smooth matte surface's light that the bumps of a pixel send on; arguments as above.

    Lambert's law is linear: where all bumps are lit, they are as bright together as the mean of their normals is long.
    None where all pixels send on all of it.
    """
    variance = _variance(mean, samples)
    for pixel in _uneven(variance):
        steps = _steps_around(geometry, pixel)
        around = geometry.reshape(-1, 3)[pixel][:, None] + steps
        variance.flat[pixel] -= np.where(around.any(-1).all(1), _largest2(steps) / 4, 1)
    share = np.sqrt(1 - variance.clip(0, 1)).astype(np.float32)
    return share if (share < 1).any() else None


def _variance(mean: np.ndarray, samples: np.ndarray | None) -> np.ndarray:
    """(H, W) mean square by which normals differ from their mean, whatever the cause; 0 without any."""
    variance = 1 - np.square(mean).sum(-1)
    if samples is not None:
        variance *= samples / (samples - 1).clip(min=1)
    variance[~mean.any(-1)] = 0
    return variance


def _uneven(variance: np.ndarray) -> Iterator[np.ndarray]:
    """Numbers (P,) of pixels with a variance, some at a time."""
    pixel = np.flatnonzero(variance > LEAST)
    return (pixel[first:first + PIXELS] for first in range(0, len(pixel), PIXELS))


def _steps_around(x: np.ndarray, pixel: np.ndarray, of=lambda x: x) -> np.ndarray:
    """(P, 9, 3) from x (H, W, 3) of pixels (P,) to those of the nine around each, of the picture."""
    height, width = x.shape[:2]
    rows, columns = (axis[:, None] + around.ravel() for axis, around in zip(
        np.divmod(pixel, width), np.mgrid[-1:2, -1:2], strict=True))
    around = of(x[rows.clip(0, height - 1), columns.clip(0, width - 1)])
    return around - around[:, 4:5]


def _largest2(steps: np.ndarray) -> np.ndarray:
    """(P,) largest squared length of steps (P, 9, 3)."""
    return np.square(steps).sum(-1).max(1)


def _goes_on(ways: np.ndarray, normal: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """(P,) bool: whether all pixels around show the same surface. ways, steps: (P, 9, 3), to their places and normals.
    """
    normal = normal[:, None]
    is_even = np.abs(dot(ways, normal)) <= EVEN * np.linalg.norm(ways, axis=-1)
    return (is_even & (normal + steps).any(-1)).all(1)
