# SPDX-License-Identifier: GPL-3.0-or-later
"""Hue, saturation and value or lightness: (..., 3) to (..., 3) each, hue from 0 to 1."""
from __future__ import annotations

import numpy as np

from ..data.arrays import divided


def _hue(rgb, high, chroma):
    r, g, b = np.moveaxis(rgb, -1, 0)
    safe = np.where(chroma != 0, chroma, 1)
    hue = np.select([chroma == 0, high == r, high == g], [0 * r, (g - b) / safe, 2 + (b - r) / safe],
                    4 + (r - g) / safe)
    return hue / 6 % 1


def rgb_to_hsv(rgb: np.ndarray) -> np.ndarray:
    high = rgb.max(axis=-1)
    chroma = high - rgb.min(axis=-1)
    return np.stack([_hue(rgb, high, chroma), divided(chroma, high), high], axis=-1)


def hsv_to_rgb(hsv: np.ndarray) -> np.ndarray:
    """Hues beyond 1 are magenta to red."""
    h, s, v = np.moveaxis(hsv, -1, 0)
    sixth = np.where(h == 1, 0, h) * 6
    sector = np.floor(sixth)
    up = sixth - sector
    low, down, rising = v * (1 - s), v * (1 - s * up), v * (1 - s * (1 - up))
    red = np.select([sector == i for i in range(5)], [v, down, low, low, rising], v)
    green = np.select([sector == i for i in range(5)], [rising, v, v, down, low], low)
    blue = np.select([sector == i for i in range(5)], [low, low, rising, v, v], down)
    return np.where((s == 0)[..., None], v[..., None], np.stack([red, green, blue], axis=-1))


def rgb_to_hsl(rgb: np.ndarray) -> np.ndarray:
    high, low = rgb.max(axis=-1), rgb.min(axis=-1)
    chroma, lightness = high - low, np.minimum((high + low) / 2, 1)
    saturation = divided(chroma, np.where(lightness > 0.5, 2 - high - low, high + low))
    return np.stack([_hue(rgb, high, chroma), saturation, lightness], axis=-1)


def hsl_to_rgb(hsl: np.ndarray) -> np.ndarray:
    h, s, lightness = np.split(hsl, 3, axis=-1)
    ramp = np.clip((np.abs(h * 6 - [3, 2, 4]) - [1, 2, 2]) * [1, -1, -1], 0, 1)
    return (ramp - 0.5) * (1 - np.abs(2 * lightness - 1)) * s + lightness


TO_RGB = {"RGB": lambda color: color, "HSV": hsv_to_rgb, "HSL": hsl_to_rgb}
FROM_RGB = {"RGB": lambda color: color, "HSV": rgb_to_hsv, "HSL": rgb_to_hsl}
