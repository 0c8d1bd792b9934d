# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that a sheen sends on: a linearly transformed cosine and its albedo, fitted to Cycles' Sheen BSDF.

Zeltner et al. 2022, "Practical multiple-scattering sheen using linearly transformed cosines".
"""
from __future__ import annotations

import numpy as np

LEAST_ROUGHNESS = 0.1   # below which next to nothing is sent on
LEAST_COSINE = 0.05     # to the viewer, that lobes were fitted at
COSINES = (np.arange(64, dtype=np.float32) + 0.5) / 64


def albedo(cosine: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    """Share of light that white sheen sends on where it is seen at this cosine to the normal; shapes as they are."""
    roughness, cosine = np.clip(roughness, LEAST_ROUGHNESS, 1), np.clip(cosine, 0, 1)
    steepness = 1.993 / roughness ** 1.275 - 1.245
    return np.exp(0.044 / roughness - 0.4 - steepness * cosine ** 1.184)


def mean_albedo(roughness) -> np.ndarray:
    """Share of light from everywhere, at these roughnesses (..., 1), that white sheen sends on to all sides."""
    return 2 * (albedo(COSINES, np.asarray(roughness)) * COSINES).mean(-1, keepdims=True)


def stretch(roughness, cosine):
    """What directions are scaled by across the normal to become those of a cosine, where sheen is seen at this cosine
    to the normal; arrays or tensors, shapes as they are."""
    roughness, cosine = roughness.clip(LEAST_ROUGHNESS, 1), cosine.clip(LEAST_COSINE, 1)
    from_above = 1.431 * roughness - 0.528 * roughness ** 2 - 0.017
    return from_above * cosine ** (0.041 + 0.383 * (1 - roughness))


def lean(roughness, cosine):
    """What they are moved by toward the viewer's side besides, for each unit along the normal; arguments alike.

    It is less than 0, so that light from that side counts more.
    """
    roughness, cosine = roughness.clip(LEAST_ROUGHNESS, 1), cosine.clip(LEAST_COSINE, 1)
    steep, flat = 0.749 * roughness ** 2, 0.446 * (1 - cosine) ** (7.9 / roughness)
    return -(1 - roughness) * (1 - cosine) ** 0.5 * (steep + flat)
