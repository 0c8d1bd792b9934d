# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply coat, sheen and thin film to the surface below them, because the network has no layers."""
from __future__ import annotations

import numpy as np

from ....model.material.sheen import mean_albedo

WAVELENGTHS = (630.0, 532.0, 465.0)  # nm, where red, green and blue are
STRONGEST = 0.9  # largest amplitude of reflection


def normal_reflectance(ior) -> np.ndarray:
    return ((ior - 1) / (ior + 1)) ** 2


def under_film(reflectance, thickness, ior) -> np.ndarray:
    """Reflectance at normal incidence of a surface of such a `reflectance` under a thin film, `thickness` in nm.

    The mean over three wavelengths (Airy 1833), without the film's tint.
    """
    below = (1 + np.sqrt(np.clip(reflectance, 0, STRONGEST))) / (1 - np.sqrt(np.clip(reflectance, 0, STRONGEST)))
    front, back = (1 - ior) / (1 + ior), (ior - below) / (ior + below)
    total = 0.0
    for wavelength in WAVELENGTHS:
        both = 2 * front * back * np.cos(4 * np.pi * ior * thickness / wavelength)
        total = total + (front ** 2 + back ** 2 + both) / (1 + (front * back) ** 2 + both)
    return np.where(thickness > 0, total / len(WAVELENGTHS), reflectance)


def effective_ior(ior, level, coat=0.0, film=(0.0, 1.33)) -> np.ndarray:
    """IOR that at Specular IOR Level 1 reflects as much as `ior` at `level` (docs/scene-input.md 3.2).

    coat: reflectance of the layer above. film: thickness in nm and IOR of the film between.
    """
    reflectance = under_film(2 * np.maximum(level, 0) * normal_reflectance(ior), *film)
    amplitude = np.minimum(np.sqrt((1 - (1 - coat) * (1 - reflectance)) / 2), STRONGEST)
    return (1 + amplitude) / (1 - amplitude)


def under_sheen(color, sheen, roughness) -> np.ndarray:
    """Base colour (..., 3) with the light that sheen of a colour (..., 3) reflects, and without what it absorbs."""
    reflected = sheen * mean_albedo(roughness)
    return color * (1 - reflected.max(axis=-1, keepdims=True)) + reflected
