# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat triangles that replace lamps, and black ones that limit where they shine."""
from __future__ import annotations

import numpy as np

from ....model.scene import RenderScene, constant_tile
from . import proxies

TILES = np.stack([constant_tile((1, 1, 1), roughness=1, ior=1), constant_tile((0, 0, 0), roughness=1, ior=1)])
EMITTING, BLACK = 0, 1  # rows of TILES


def black(triangles: np.ndarray) -> RenderScene:
    """What casts shadows and reflects nothing, of (n, 3, 3) corners."""
    return shining(triangles, np.zeros(3), tile=BLACK)


def shining(triangles: np.ndarray, radiance, axis=(0, 0, 0), cosines=(0, 0), tile: int = EMITTING) -> RenderScene:
    """(n, 3, 3) flat triangles of one radiance (3,), or of (n, 3), that share a beam (model/scene.py) and a tile."""
    n = len(triangles)

    def each(value, *shape):
        return np.broadcast_to(np.float32(value), (n, *shape)).copy()

    flat = np.repeat(proxies.normals(triangles)[:, None], 3, axis=1) if n else triangles
    return RenderScene(
        triangles=triangles.astype(np.float32), normals=flat.astype(np.float32), emission=each(radiance, 3),
        beam_axis=each(axis, 3), beam_cosine=each(cosines, 2), tile_index=np.full(n, tile, np.int32),
        tiles=TILES.copy(), seen=np.zeros(n, bool))


DARK = black(np.zeros((0, 3, 3)))
