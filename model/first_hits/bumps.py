# SPDX-License-Identifier: GPL-3.0-or-later
"""Bumps finer than a pixel: the mean of its normals is nearly that of a smooth surface, but the light that they mirror
spreads as if that were rougher (Toksvig 2005)."""
from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..geometry import dot, unit
from ..pictures import bands

LEAST = 1e-4  # variance of normals that widens no lobe
EVEN = 0.3    # largest slope of the way to the next pixel, from the surface, where that goes on


def normal_variance(mean: np.ndarray, samples: np.ndarray | None, position: np.ndarray,
                    geometry: np.ndarray) -> np.ndarray | None:
    """(H, W) f32 mean square by which normals differ in a pixel from their mean, beyond what is seen of it.

    mean: (H, W, 3), of the unit normals of `samples` (H, W); position and geometry: (H, W, 3), in the middle of pixels,
    and unit normals without bumps there; 0 = no hit. 0 where other surfaces are near. None where there are no bumps.
    """
    variance = np.concatenate([_normal_variance(
        mean[outer], None if samples is None else samples[outer], position[outer], geometry[outer])[inner]
        for outer, inner in bands(*mean.shape[:2], margin=1)])
    return variance if (variance > LEAST).any() else None


def _normal_variance(mean: np.ndarray, samples: np.ndarray | None, position: np.ndarray,
                     geometry: np.ndarray) -> np.ndarray:
    """The same of some rows."""
    spread = 1 - np.square(mean).sum(-1)
    if samples is not None:
        spread *= samples / (samples - 1).clip(min=1)
    # Two surfaces that share a pixel differ from their mean by half of their difference at most.
    explained = np.maximum(_largest_step2(geometry), _largest_step2(unit(mean))) / 4
    return np.where(_goes_on(position, geometry) & mean.any(-1), spread - explained, 0).clip(0, 1).astype(np.float32)


def widened(roughness: np.ndarray, variance: np.ndarray | None) -> np.ndarray:
    """(H, W) roughness of lobes as wide as those of all bumps of a pixel together."""
    return roughness if variance is None else ((roughness ** 4 + variance) ** 0.25).clip(max=1)


def _largest_step2(x: np.ndarray) -> np.ndarray:
    """(H, W) largest squared difference of x (H, W, 3) from that of a pixel around."""
    return np.max([np.square(step).sum(-1) for step in _steps(x)], axis=0)


def _goes_on(position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(H, W) bool: whether all pixels around show the same surface."""
    even = [np.abs(dot(step, normal)) <= EVEN * np.linalg.norm(step, axis=-1) for step in _steps(position)]
    return np.all([*even, *((normal + step).any(-1) for step in _steps(normal))], axis=0)


def _steps(x: np.ndarray) -> Iterator[np.ndarray]:
    """(H, W, 3) from each pixel to each of the nine around it, those in the picture."""
    height, width = x.shape[:2]
    around = np.pad(x, ((1, 1), (1, 1), (0, 0)), mode="edge")
    for row, column in np.ndindex(3, 3):
        yield around[row:row + height, column:column + width] - x
