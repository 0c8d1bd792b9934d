# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of its radiance a light sends out in each direction: smooth cones, and Blender's area lamps with a Spread.

Borders are pairs as of `beam_cosine` in scene.py.
"""
from __future__ import annotations

import functools
import math

import numpy as np

SPREAD = -1.0       # the second of a pair: radiance falls linearly in the tangent, to 0 at the first
LEAST_EDGE = 1e-4   # in the cosine
STEPS = 200         # of angles


def beam_share(cosine: np.ndarray, borders: np.ndarray) -> np.ndarray:
    """Share of its radiance that a light of borders (..., 2) sends at cosines (...) to its axis."""
    outer, inner = np.moveaxis(np.asarray(borders), -1, 0)
    t = ((cosine - outer) / np.maximum(inner - outer, LEAST_EDGE)).clip(0, 1)
    linear = 1 - _tangent(cosine) / np.maximum(_tangent(outer), 1e-9)
    return np.where(inner == SPREAD, linear.clip(0), t * t * (3 - 2 * t))


def spread_borders(spread: float) -> tuple[float, tuple[float, float]]:
    """Gain on the radiance and borders of an area lamp with a Spread (radians) below pi, as in Cycles: its light is
    (tan H - tan a) / (tan H - H) times that of a lamp without one, H being half the spread."""
    half = min(spread / 2, math.pi / 2 - 1e-3)
    return math.tan(half) / max(math.tan(half) - half, 1e-12), (math.cos(half), SPREAD)


def smoothed(radiance: np.ndarray, borders: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (L, 3) and borders (L, 2) without any Spread, which no network was trained with: smooth cones with as
    much light and the same border, whose inner cosine is above 1 where they are peaked."""
    radiance, borders = radiance.copy(), borders.copy()
    is_spread = borders[:, 1] == SPREAD
    for outer in np.unique(borders[is_spread, 0]):
        rows = is_spread & (borders[:, 0] == outer)
        gain, borders[rows, 1] = _nearest_smooth(float(outer))
        radiance[rows] *= gain
    return radiance, borders


@functools.lru_cache(maxsize=64)
def _nearest_smooth(outer: float) -> tuple[float, float]:
    """Gain and inner cosine of the least-squares fit to a Spread, once for all lamps that have it."""
    angle = np.linspace(0, math.acos(outer), STEPS)
    flux = np.cos(angle) * np.sin(angle)
    inner = outer + (1 - outer) * np.linspace(0.05, 1.5, 150)
    exact = beam_share(np.cos(angle), np.float64([outer, SPREAD]))
    smooth = beam_share(np.cos(angle), np.stack([np.full_like(inner, outer), inner], 1)[:, None])
    gain = (exact * flux).sum() / (smooth * flux).sum(axis=1)
    best = int(((gain[:, None] * smooth - exact) ** 2 * flux).sum(axis=1).argmin())
    return float(gain[best]), float(inner[best])


def _tangent(cosine: np.ndarray) -> np.ndarray:
    cosine = np.clip(cosine, 1e-6, 1)
    return np.sqrt(1 - cosine * cosine) / cosine
