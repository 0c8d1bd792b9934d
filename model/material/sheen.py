# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that a sheen sends on: a linearly transformed cosine and its albedo, fitted to Cycles' Sheen BSDF.

Zeltner et al. 2022, "Practical multiple-scattering sheen using linearly transformed cosines", whose cosines are nearly
round about the normal, and nearly the same from all sides: so they are taken to be.
"""
from __future__ import annotations

import numpy as np

LEAST_ROUGHNESS = 0.1   # below which next to nothing is sent on
COSINES = (np.arange(64, dtype=np.float32) + 0.5) / 64


def albedo(cosine: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    """Share of light that white sheen sends on where it is seen at this cosine to the normal; shapes as they are."""
    roughness, cosine = np.clip(roughness, LEAST_ROUGHNESS, 1), np.clip(cosine, 0, 1)
    steepness = 1.993 / roughness ** 1.275 - 1.245
    return np.exp(0.044 / roughness - 0.4 - steepness * cosine ** 1.184)


def mean_albedo(roughness) -> np.ndarray:
    """Share of light from everywhere, at these roughnesses (..., 1), that white sheen sends on to all sides."""
    return 2 * (albedo(COSINES, np.asarray(roughness)) * COSINES).mean(-1, keepdims=True)


def stretch(roughness):
    """What directions are scaled by across the normal to become those of a cosine; array or tensor, as they are."""
    return 0.95 * roughness.clip(LEAST_ROUGHNESS, 1) - 0.064
