# SPDX-License-Identifier: GPL-3.0-or-later
"""Coat and sheen of Principled BSDF as changes of what lies below them: the network knows no layers."""
from __future__ import annotations

import numpy as np

from .arrays import mixed

# Share of light from all sides that sheen of weight 1 turns back, measured in Cycles on a white-lit sphere.
SHEEN_ROUGHNESS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
SHEEN = (0.0, 0.0, 0.006, 0.022, 0.104, 0.230, 0.438)
STRONGEST = 0.9  # amplitude of reflection that is not exceeded


def normal_reflectance(ior) -> np.ndarray:
    return ((ior - 1) / (ior + 1)) ** 2


def effective_ior(ior, level, coat=0.0) -> np.ndarray:
    """Index that reflects at Specular IOR Level 1 like `ior` at `level` (docs/scene-input.md 3.2).

    coat: reflectance of a layer above, which reflects before.
    """
    reflectance = 2 * np.maximum(level, 0) * normal_reflectance(ior)
    amplitude = np.minimum(np.sqrt((1 - (1 - coat) * (1 - reflectance)) / 2), STRONGEST)
    return (1 + amplitude) / (1 - amplitude)


def shared_roughness(below, gloss, above, coat) -> np.ndarray:
    """Of a surface of roughness `below` under a coat of roughness `above`, weighted by what each reflects."""
    return (gloss * below + coat * above) / np.maximum(gloss + coat, 1e-6)


def under_sheen(color, weight, roughness, tint) -> np.ndarray:
    """Base colour (..., 3) with what sheen adds, less what it keeps from it."""
    return mixed(color, tint, weight * np.interp(roughness, SHEEN_ROUGHNESS, SHEEN))
