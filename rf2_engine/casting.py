# SPDX-License-Identifier: GPL-3.0-or-later
"""Trees of triangles, and rays against them, by Blender's BVH."""
from __future__ import annotations

import gc
from contextlib import contextmanager

import numpy as np

from mathutils.bvhtree import BVHTree


@contextmanager
def uncollected():
    """Inside, Python looks for no garbage. Long lists make it do so, and with PyTorch loaded it takes 0.15 s a time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@uncollected()
def tree_of(corners: np.ndarray, faces: np.ndarray | None = None) -> BVHTree:
    """Of triangles (N, 3, 3), or of (N, 3) faces whose corners are among (V, 3)."""
    points = corners.reshape(-1, 3)
    if faces is None:
        faces = np.arange(len(points)).reshape(-1, 3)
    return BVHTree.FromPolygons(_tuples(points), _tuples(faces), all_triangles=True)


@uncollected()
def cast(tree: BVHTree, origins: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest triangle (S,) i32, -1 if none, and distance (S,) f32 for unit rays (S, 3) from (3,) or (S, 3)."""
    find = tree.ray_cast
    starts = np.broadcast_to(origins, rays.shape).tolist()
    hits = [find(start, ray)[2:] for start, ray in zip(starts, rays.tolist(), strict=True)]
    triangle = np.fromiter((-1 if index is None else index for index, _ in hits), np.int32, len(hits))
    distance = np.fromiter((length or 0.0 for _, length in hits), np.float32, len(hits))
    return triangle, distance


def _tuples(rows: np.ndarray) -> list[tuple]:
    """Of plain numbers, which take Blender a third of the time of lists of lists."""
    return list(zip(*rows.T.tolist(), strict=True))
