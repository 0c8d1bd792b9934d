# SPDX-License-Identifier: GPL-3.0-or-later
"""The colour scale of FLIP maps: from dark violet for no visible difference to bright yellow."""
from __future__ import annotations

import numpy as np

STOPS = np.array([
    (0, 0, 4), (10, 8, 34), (29, 17, 71), (54, 16, 107), (81, 18, 124), (106, 28, 129), (131, 38, 129), (156, 46, 127),
    (183, 55, 121), (208, 65, 111), (231, 82, 99), (245, 107, 92), (252, 137, 97), (254, 167, 114), (254, 196, 136),
    (253, 226, 163), (252, 253, 191)], np.float32) / 255  # sRGB-encoded, at equal distances from 0 to 1


def magma(values: np.ndarray) -> np.ndarray:
    """Values in [0, 1], any shape -> sRGB-encoded colours (..., 3) f32."""
    places = np.linspace(0, 1, len(STOPS))
    return np.stack([np.interp(values, places, STOPS[:, c]) for c in range(3)], -1).astype(np.float32)
