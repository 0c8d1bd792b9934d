# SPDX-License-Identifier: GPL-3.0-or-later
"""Byte storage of latent maps (docs/scene-input.md 4.3)."""
from __future__ import annotations

import numpy as np


def quantise(latent: np.ndarray) -> np.ndarray:
    """[-1, 1] -> u8; truncates as the official pipeline does, and clips what lies outside."""
    scaled = np.clip((np.asarray(latent, np.float32) + 1) / 2, 0, 1)
    return np.floor(scaled * np.float32(255)).astype(np.uint8)


def dequantise(stored: np.ndarray) -> np.ndarray:
    """u8 -> [-1, 1] f32."""
    return 2 * (stored.astype(np.float32) / 255 - np.float32(0.5))
