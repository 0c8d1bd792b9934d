# SPDX-License-Identifier: GPL-3.0-or-later
"""Barycentric tiles sampled from texture maps (spec/scene-input.md 4.2, 4.3)."""
from __future__ import annotations

import numpy as np

from .environment import sample_bilinear
from .scene import barycentric_grid


def tile_uv(uv: np.ndarray) -> np.ndarray:
    """(N, 3, 2) corner UVs -> (N, 32, 32, 2) UV of every tile cell; beyond the hypotenuse it is extrapolated."""
    return np.einsum("rcw,nwk->nrck", barycentric_grid(), uv)


def sample_tiles(maps: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Bilinear samples of (H, W, C) maps, row 0 on top = V 1, for triangles with (N, 3, 2) UVs -> (N, C, 32, 32) f32.

    UVs outside [0, 1] take the border's value, as the official sampler does.
    """
    height, width = maps.shape[:2]
    cells = tile_uv(uv)
    samples = sample_bilinear(maps, cells[..., 0] * width - 0.5, (1 - cells[..., 1]) * height - 0.5)
    return np.ascontiguousarray(samples.transpose(0, 3, 1, 2), dtype=np.float32)
