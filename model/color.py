# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours and the number formats that they are stored in; scene-linear means Rec.709 primaries."""
from __future__ import annotations

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of scene-linear RGB
HALF_MAX = 65504.0  # the largest half float


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """sRGB values in [0, 1] -> scene-linear, any shape."""
    return np.where(encoded <= 0.04045, encoded / 12.92, (np.maximum(encoded, 0) * (1 / 1.055) + 0.055 / 1.055) ** 2.4)


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Scene-linear -> sRGB, clipped to [0, 1]; f32, any shape. NaN becomes 0."""
    x = np.clip(np.nan_to_num(linear), 0, 1).astype(np.float32)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def to_half(x: np.ndarray) -> np.ndarray:
    """As f16, clipped to what that can hold."""
    return np.clip(x, -HALF_MAX, HALF_MAX).astype(np.float16)
