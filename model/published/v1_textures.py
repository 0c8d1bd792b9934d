# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures of H5 scenes of the first RenderFormer: parameters, of which the second makes latents."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from ..scene import Channels

V1 = Channels(1, diffuse=3, specular=3, roughness=1, normal=3, emission=3)  # of a tile; the normal is (n + 1) / 2
BRDF = slice(0, V1["normal"].start)


def raw_tiles(tiles: np.ndarray, diffuse_specular: Callable[[torch.Tensor], torch.Tensor]) -> torch.Tensor:
    """(t, 13, q, q) tiles -> (t, 16, q, q) raw ones of docs/scene-input.md 4.1, without height.

    diffuse_specular: (..., 7) -> (..., 9) latents.
    """
    whole = torch.from_numpy(fill_tiles(tiles.astype(np.float32)))
    latent = diffuse_specular(whole[:, BRDF].movedim(1, -1)).movedim(-1, 1).to(whole)
    return torch.cat([latent, 2 * whole[:, V1["normal"]] - 1, whole[:, V1["emission"]],
                      torch.zeros_like(whole[:, :1])], 1)


def fill_tiles(tiles: np.ndarray) -> np.ndarray:
    """(t, c, q, q) tiles whose half beyond the triangle's long side, which is 0 in files, mirrors the other."""
    side = np.arange(tiles.shape[-1])
    beyond = side[:, None] + side > len(side) - 1
    return np.where(beyond, tiles[..., ::-1, ::-1].swapaxes(-1, -2), tiles)
