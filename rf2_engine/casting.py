# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against token triangles, by Blender's BVH."""
from __future__ import annotations

import gc
from contextlib import contextmanager

import numpy as np

from mathutils.bvhtree import BVHTree


@contextmanager
def _uncollected():
    """Inside, Python looks for no garbage. Long lists make it do so, and with PyTorch loaded it takes 0.15 s a time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@_uncollected()
def tree_of(triangles: np.ndarray) -> BVHTree:
    """Of (N, 3, 3) corners."""
    corners = triangles.reshape(-1, 3)
    return BVHTree.FromPolygons(corners.tolist(), np.arange(len(corners)).reshape(-1, 3).tolist(), all_triangles=True)


@_uncollected()
def cast(tree: BVHTree, origins: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest triangle (S,) i32, -1 if none, and distance (S,) f32 for unit rays (S, 3) from (3,) or (S, 3)."""
    find = tree.ray_cast
    starts = np.broadcast_to(origins, rays.shape).tolist()
    hits = [find(start, ray)[2:] for start, ray in zip(starts, rays.tolist(), strict=True)]
    triangle = np.fromiter((-1 if index is None else index for index, _ in hits), np.int32, len(hits))
    distance = np.fromiter((length or 0.0 for _, length in hits), np.float32, len(hits))
    return triangle, distance
