# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise first hits behind smoke and fog.

A camera ray either scatters in a medium or reaches the surface behind it, by chance. So with a few samples, coverage
and colours are noisy there. They are averaged over neighbouring pixels, because a medium varies slowly.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from .box_filter import box_sums
from .camera import view_rays
from .geometry import rotation_matrix
from .scene import CELLS, Guides, View, Volumes

RADIUS = 4           # pixels, of the square that is averaged
CLEAR = 0.1          # transmittance below which the background behind a medium is averaged too
COLORS = ("diffuse_color", "glossy_color", "transmission_color")
PASSES = (*COLORS, "environment")  # of the guides, those that `smoothed` changes besides alpha


def smoothed(guides: Guides, volumes: Volumes | None, view: View) -> Guides:
    """Guides whose coverage and colours, and the environment by it, are local means where a ray crosses a medium.

    All in one frame, of whatever units.
    """
    inside = None if volumes is None or not len(volumes) else crossed(guides, volumes, view)
    if inside is None or not inside.any():
        return guides
    inside = inside[..., None]
    count = np.maximum(box_sums(inside.astype(np.float32), RADIUS), 1)

    def mean(values: np.ndarray) -> np.ndarray:
        layers = values.reshape(*inside.shape[:2], -1)
        means = np.where(inside, box_sums(layers * inside, RADIUS) / count, layers)
        return means.reshape(values.shape).astype(np.float32)

    changed = {name: mean(getattr(guides, name)) for name in (*COLORS, "alpha")}
    through, clear = 1 - guides.alpha[..., None], 1 - changed["alpha"][..., None]
    behind = np.where(through > CLEAR, guides.environment / np.maximum(through, CLEAR),
                      mean(guides.environment) / np.maximum(clear, 1e-3))
    environment = np.where(inside, behind * clear, guides.environment)
    return replace(guides, environment=environment.astype(np.float32), **changed)


def crossed(guides: Guides, volumes: Volumes, view: View) -> np.ndarray:
    """(H, W) bool: the ray through the pixel's centre meets the box around a medium's cells before what it hits."""
    origin, rays = view_rays(view)
    hit = guides.hit_triangle >= 0
    farthest = np.where(hit, np.linalg.norm(guides.position - origin, axis=-1), np.inf)
    result = np.zeros(hit.shape, bool)
    boxes = np.concatenate([volumes.rotation, volumes.scale, volumes.scattering, volumes.absorption], axis=1)
    for box in np.unique(boxes, axis=0):
        cells = (boxes == box).all(axis=1)
        turn = rotation_matrix(box[:3]).astype(np.float32)
        places, half = volumes.position[cells] @ turn, box[3:6] / CELLS / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse, eye = 1 / (rays @ turn), origin @ turn
            a, b = ((corner - eye) * inverse for corner in (places.min(axis=0) - half, places.max(axis=0) + half))
        enter, leave = np.nanmax(np.minimum(a, b), axis=-1), np.nanmin(np.maximum(a, b), axis=-1)
        result |= (enter < leave) & (leave > 0) & (enter < farthest)
    return result
