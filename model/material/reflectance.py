# SPDX-License-Identifier: GPL-3.0-or-later
"""How much light the glossy layer of a dielectric reflects (docs/scene-input.md 3.2)."""
from __future__ import annotations

import numpy as np

SMOOTH = 4.08567, 1.00071  # of the mean reflectance of a smooth dielectric (Kulla and Conty 2017)
ROUGH = 0.78, 1.2          # how much less a rough one reflects: fitted to Cycles' Glossy Color
BLURRED = 0.45             # GGX alpha at least behind a diffuse bounce: what Filter Glossy 1 makes of it in the mean


def normal_reflectance(ior: np.ndarray) -> np.ndarray:
    """Share of the light at normal incidence that a layer of a tile's index, which stands for level 1, reflects."""
    return 2 * ((ior - 1) / (ior + 1)) ** 2


def blurred(roughness: np.ndarray) -> np.ndarray:
    """Perceptual roughness, as it is where Cycles sees a surface from a matte one."""
    return np.maximum(roughness, BLURRED ** 0.5)


def layer_reflectance(ior: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    """The same of light from everywhere; roughness is perceptual, 0 to 1."""
    amplitude = np.sqrt(normal_reflectance(np.maximum(ior, 1)))
    index = (1 + amplitude) / np.maximum(1 - amplitude, 1e-3)
    return (index - 1) / (SMOOTH[0] + SMOOTH[1] * index) * (1 - ROUGH[0] * roughness ** ROUGH[1])
