# SPDX-License-Identifier: GPL-3.0-or-later
"""Gabor noise: phasors scattered over a lattice and added (Lagae et al. 2009; Tricard et al. 2019)."""
from __future__ import annotations

import itertools

import numpy as np

from .hashing import of_floats
from .lattice import Lattice

IMPULSES = 8              # in each cell
FARTHEST = 2**24           # beyond, cells are as close together as numbers are


def phasor(at, frequency, isotropy, *angles):
    """Real and imaginary part (m,) at points (d, m)."""
    cell = np.clip(np.nan_to_num(np.floor(at)), -FARTHEST, FARTHEST).astype(np.int32)
    part = at - cell
    centers = Lattice(_centers, cell, -1, 1)
    real, imaginary = np.zeros(at.shape[1], np.float32), np.zeros(at.shape[1], np.float32)
    for offset in itertools.product((-1, 0, 1), repeat=len(at)):
        ways = part - np.float32(offset)[:, None] - centers[offset].reshape(IMPULSES, *at.shape)
        for impulse, squares in enumerate(np.square(ways).sum(axis=1)):
            near = np.flatnonzero(squares < 1)
            way, squared = ways[impulse][:, near], squares[near]
            where = (cell[:, near] + np.int32(offset)[:, None]).astype(np.float32)
            sign = np.where(of_floats(*where, np.float32(3 * impulse + 2)) < 0.5, -1, 1)
            window = (0.5 + 0.5 * np.cos(np.pi * squared)) * np.exp(-np.pi * squared) * sign
            along = _direction(where, np.float32(3 * impulse), isotropy[near], [angle[near] for angle in angles])
            wave = 2 * np.pi * frequency[near] * (way * along).sum(axis=0)
            real[near] += window * np.cos(wave)
            imaginary[near] += window * np.sin(wave)
    return real, imaginary


def _centers(where):
    """(IMPULSES * d, ...) of the impulses in cells (d, ...)."""
    where = where.astype(np.float32)
    return np.concatenate([_center(where, np.float32(3 * impulse + 1)) for impulse in range(IMPULSES)])


def _center(where, seed):
    if len(where) == 2:
        x, y = where
        return np.stack([of_floats(x, y, seed), of_floats(seed, x, y)])
    x, y, z = where
    return np.stack([of_floats(x, y, z, seed), of_floats(z, x, seed, y), of_floats(seed, z, y, x)])


def _direction(where, seed, isotropy, angles):
    if len(where) == 2:
        angle = angles[0] + (of_floats(*where, seed) - 0.5) * np.pi * isotropy
        return np.stack([np.cos(angle), np.sin(angle)])
    x, y, z = where
    inclination = angles[0] + of_floats(x, y, z, seed) * np.pi * isotropy
    azimuth = angles[1] + of_floats(z, x, seed, y) * np.pi * isotropy
    return np.stack([np.sin(inclination) * np.cos(azimuth), np.sin(inclination) * np.sin(azimuth), np.cos(inclination)])
