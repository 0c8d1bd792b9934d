# SPDX-License-Identifier: GPL-3.0-or-later
"""What the authors' pipeline does with texture maps: byte storage of latent maps, and barycentric tiles sampled from
maps (docs/scene-input.md 4.2, 4.3). The add-on evaluates Blender's nodes at the texels of its tiles instead.
"""
from __future__ import annotations

import numpy as np
import torch

from renderformer_v2.model.environment import sample_bilinear
from renderformer_v2.model.scene import barycentric_grid


def tile_uv(uv: np.ndarray) -> np.ndarray:
    """(N, 3, 2) corner UVs -> (N, 32, 32, 2) f32 UV of every tile cell; beyond the hypotenuse it is extrapolated."""
    cells = 0.0
    for weight, corner in zip(np.moveaxis(barycentric_grid().astype(np.float64), -1, 0), np.moveaxis(uv, 1, 0)):
        cells = (weight[..., None] * corner[:, None, None] + cells).astype(np.float32)  # multiplied and added in one
    return cells


def sample_tiles(maps: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Bilinear samples of (H, W, C) maps, row 0 on top = V 1, for triangles with (N, 3, 2) UVs -> (N, C, 32, 32) f32.

    UVs outside [0, 1] take the border's value, as the official sampler does.
    """
    cells = torch.from_numpy(tile_uv(uv))
    coordinates = torch.stack([2 * cells[..., 0] - 1, 1 - 2 * cells[..., 1]], dim=-1).flatten(0, 1)
    samples = sample_bilinear(maps, coordinates).reshape(*cells.shape[:3], -1)
    return np.ascontiguousarray(samples.transpose(0, 3, 1, 2))


def quantise(latent: np.ndarray) -> np.ndarray:
    """[-1, 1] -> u8; truncates as the official pipeline does, and clips what lies outside."""
    scaled = np.clip((np.asarray(latent, np.float32) + 1) / 2, 0, 1)
    return np.floor(scaled * np.float32(255)).astype(np.uint8)


def dequantise(stored: np.ndarray) -> np.ndarray:
    """u8 -> [-1, 1] f32."""
    return 2 * (stored.astype(np.float32) / 255 - np.float32(0.5))
