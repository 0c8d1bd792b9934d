# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply coat, sheen and thin film to the surface below them, because the network has no layers."""
from __future__ import annotations

import numpy as np

from ..data.arrays import mixed

# Share of light from all sides that sheen of weight 1 turns back, measured in Cycles on a white-lit sphere.
SHEEN_ROUGHNESS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
SHEEN = (0.0, 0.0, 0.006, 0.022, 0.104, 0.230, 0.438)
WAVELENGTHS = (630.0, 532.0, 465.0)  # nm, where red, green and blue are
STRONGEST = 0.9  # amplitude of reflection that is not exceeded


def normal_reflectance(ior) -> np.ndarray:
    return ((ior - 1) / (ior + 1)) ** 2


def under_film(reflectance, thickness, ior) -> np.ndarray:
    """Reflectance seen from straight above of what reflects `reflectance`, below a film of a thickness in nm.

    The mean over three wavelengths (Airy 1833): what it tints is left out.
    """
    below = (1 + np.sqrt(np.clip(reflectance, 0, STRONGEST))) / (1 - np.sqrt(np.clip(reflectance, 0, STRONGEST)))
    front, back = (1 - ior) / (1 + ior), (ior - below) / (ior + below)
    total = 0.0
    for wavelength in WAVELENGTHS:
        both = 2 * front * back * np.cos(4 * np.pi * ior * thickness / wavelength)
        total = total + (front ** 2 + back ** 2 + both) / (1 + (front * back) ** 2 + both)
    return np.where(thickness > 0, total / len(WAVELENGTHS), reflectance)


def effective_ior(ior, level, coat=0.0, film=(0.0, 1.33)) -> np.ndarray:
    """Index that reflects at Specular IOR Level 1 like `ior` at `level` (docs/scene-input.md 3.2).

    coat: reflectance of a layer above, which reflects before. film: thickness in nm and index of the one between.
    """
    reflectance = under_film(2 * np.maximum(level, 0) * normal_reflectance(ior), *film)
    amplitude = np.minimum(np.sqrt((1 - (1 - coat) * (1 - reflectance)) / 2), STRONGEST)
    return (1 + amplitude) / (1 - amplitude)


def shared_roughness(below, gloss, above, coat) -> np.ndarray:
    """Of a surface of roughness `below` under a coat of roughness `above`, weighted by what each reflects."""
    return (gloss * below + coat * above) / np.maximum(gloss + coat, 1e-6)


def under_sheen(color, weight, roughness, tint) -> np.ndarray:
    """Base colour (..., 3) with what sheen adds, less what it keeps from it."""
    return mixed(color, tint, weight * np.interp(roughness, SHEEN_ROUGHNESS, SHEEN))
