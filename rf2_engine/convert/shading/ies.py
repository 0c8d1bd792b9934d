# SPDX-License-Identifier: GPL-3.0-or-later
"""IES profiles (LM-63, photometry of type C): the light of a luminaire by direction."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Profile:
    """Candelas (columns, rows) at angles in degrees: `around` (columns,) the vertical, 0 to 360, `polar` from below."""

    polar: np.ndarray
    azimuth: np.ndarray
    candela: np.ndarray
    bulges: bool = False  # as rf2_engine/compat.py has it

    def __call__(self, directions: np.ndarray) -> np.ndarray:
        """(..., 1) f32 candelas in unit directions (..., 3) away from the lamp, which hangs along -Z."""
        x, y, z = np.moveaxis(directions.astype(np.float64), -1, 0)
        polar = np.degrees(np.arccos(np.clip(-z, -1, 1)))
        azimuth = np.degrees(np.arctan2(-x, -y)) % 360
        row, down = _place(self.polar, polar)
        column, aside = _place(self.azimuth, azimuth)
        rows, columns = len(self.polar), len(self.azimuth)
        near_rows = np.stack([np.where(row > 0, row - 1, 1), row, row + 1, np.minimum(row + 2, rows - 1)])
        following = np.where(column == columns - 2, 1, column + 2)
        near_columns = np.stack([np.where(column > 0, column - 1, columns - 2), column, column + 1, following])
        weights = _cubic(aside)
        if columns == 2 and self.bulges:  # it finds nothing beyond the two that it makes of one
            weights[[0, 3]] = 0
        samples = self.candela[near_columns[:, None], near_rows[None]]
        candela = np.einsum("c...,r...,cr...->...", weights, _cubic(down), samples)
        inside = (polar >= self.polar[0]) & (polar <= self.polar[-1])
        return (np.maximum(candela, 0) * inside)[..., None].astype(np.float32)


def read(text: str, bulges: bool = False) -> Profile:
    """Raises ValueError or IndexError when the text is no such file."""
    _, tilt, rest = text.partition("TILT=")
    words = rest.replace(",", " ").split()
    if not tilt or words[0] != "NONE":
        raise ValueError("an IES file with a tilt or without photometry")
    numbers = np.array(words[1:], float)
    factor, (rows, columns) = numbers[2] * numbers[10] * numbers[11], numbers[3:5].astype(int)
    polar, azimuth, candela = np.split(numbers[13:13 + rows + columns + rows * columns], [rows, rows + columns])
    if rows < 2 or np.any(np.diff(polar) <= 0) or np.any(np.diff(azimuth) <= 0):
        raise ValueError("an IES file whose angles do not grow")
    candela = factor * candela.reshape(columns, rows)
    if columns == 1:
        return Profile(polar, np.array([0.0, 360.0]), np.repeat(candela, 2, axis=0), bulges)
    while azimuth[-1] < 360:  # what is left of the circle is a mirror image
        azimuth = np.concatenate([azimuth, 2 * azimuth[-1] - azimuth[-2::-1]])
        candela = np.concatenate([candela, candela[-2::-1]])
    return Profile(polar, azimuth, candela, bulges)


def _place(grid: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the grid line below, and how far it is to the next."""
    index = np.clip(np.searchsorted(grid, at, side="right") - 1, 0, len(grid) - 2)
    return index, np.clip((at - grid[index]) / (grid[index + 1] - grid[index]), 0, 1)


def _cubic(t: np.ndarray) -> np.ndarray:
    """(4, ...) weights of four neighbours at `t` between the second and the third (Catmull and Rom 1974)."""
    return np.stack([((2 - t) * t - 1) * t, (3 * t - 5) * t * t + 2, ((4 - 3 * t) * t + 1) * t, (t - 1) * t * t]) / 2
