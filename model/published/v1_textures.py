# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures of H5 scenes of the first RenderFormer: parameters, of which the second makes latents."""
from __future__ import annotations

import numpy as np

from ..scene import Channels

V1 = Channels(1, diffuse=3, specular=3, roughness=1, normal=3, emission=3)  # of a tile; the normal is (n + 1) / 2
BRDF = slice(0, V1["normal"].start)


def fill_tiles(tiles: np.ndarray) -> np.ndarray:
    """(t, c, q, q) tiles whose half beyond the triangle's long side, which is 0 in files, mirrors the other."""
    side = np.arange(tiles.shape[-1])
    beyond = side[:, None] + side > len(side) - 1
    return np.where(beyond, tiles[..., ::-1, ::-1].swapaxes(-1, -2), tiles)
