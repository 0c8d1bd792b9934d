# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the change from one frame to the next at the same points of the surfaces."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from renderformer_v2.model.pictures import linear_to_srgb
from renderformer_v2.model.scene import View

ROUNDING = 0.01  # pixels, of positions in float32
SAME_SPOT = 0.5  # pixels that two points on a surface may be apart, seen from the camera


class Frame(NamedTuple):
    view: View
    radiance: np.ndarray  # (H, W, 3) f32, scene-linear
    position: np.ndarray  # (H, W, 3) f32, world, of the pixel centre's first hit; 0 where there is none


class Change(NamedTuple):
    mean: float      # absolute sRGB difference, of 1
    median: float    # the same away from silhouettes and mirrors, which change with the camera in any case
    compared: float  # share of the pixels


def measure_flicker(before: Frame, after: Frame) -> Change:
    """The change of the spots that both frames see.

    Every pixel's world position in `before` is looked up in `after`; a spot counts where the position there is the
    same to SAME_SPOT. Raises ValueError where none does.
    """
    columns, rows, depth = project_to_pixels(after.view, before.position)
    with np.errstate(invalid="ignore"):
        inside = (depth > 0) & before.position.any(axis=-1)
        for at, size in ((columns, after.view.width), (rows, after.view.height)):
            inside &= (at > -ROUNDING) & (at < size - 1 + ROUNDING)
    columns, rows = (np.where(inside, at, 0) for at in (columns, rows))
    position = _interpolate(after.position, rows, columns, order=1)
    distance = np.linalg.norm(position - before.position, axis=-1) * np.abs(after.view.focal).min()
    is_same = inside & (distance < SAME_SPOT * depth)
    color = _interpolate(linear_to_srgb(after.radiance), rows, columns, order=3)
    change = np.abs(color - linear_to_srgb(before.radiance)).mean(axis=-1)
    if not is_same.any():
        raise ValueError("two frames that follow each other see nothing in common: turn the camera by less")
    return Change(float(change[is_same].mean()), float(np.median(change[is_same])), float(is_same.mean()))


def project_to_pixels(view: View, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Column, row (of pixel centres: 0 is the first) and depth in front of the camera of world points (..., 3), f64."""
    c2w = view.camera_to_world.astype(np.float64)
    local = (points - c2w[:3, 3]) @ c2w[:3, :3]
    depth = -local[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = local[..., 0] / depth, -local[..., 1] / depth
    return x * view.focal[0] + view.principal[0] - 0.5, y * view.focal[1] + view.principal[1] - 0.5, depth


def _interpolate(picture: np.ndarray, rows: np.ndarray, columns: np.ndarray, order: int) -> np.ndarray:
    """(H, W, C) of a picture between its pixels, by splines."""
    channels = [map_coordinates(picture[..., c].astype(np.float64), (rows, columns), order=order, mode="mirror")
                for c in range(picture.shape[-1])]
    return np.stack(channels, axis=-1)
