# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays of a View (docs/scene-input.md 1.4)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from .scene import View

ROWS = 64  # computed at once in float64


def pad_view(view: View, granularity: int) -> View:
    """A rectangle extended to a grid of `granularity` pixels from the corner of the full picture, so that the network's
    windows are the same for every rectangle.

    Where the sides of the picture are neighbours (`View.wraps`), either side gets at least `granularity` more columns.
    """
    x, y = view.corner
    margin = granularity if view.wraps else 0
    left, above = x % granularity + margin, y % granularity
    width, height = left + view.width + margin, above + view.height
    return replace(view, principal=view.principal + np.float32((left, above)), corner=(x - left, y - above),
                   width=width + -width % granularity, height=height + -height % granularity)


def find_window(larger: View, view: View) -> tuple[slice, slice]:
    """The rows and columns of `larger` that show `view`, both being rectangles of one picture."""
    left, above = (a - b for a, b in zip(view.corner, larger.corner))
    return slice(above, above + view.height), slice(left, left + view.width)


def extend_sides(picture: np.ndarray, left: int, right: int, wraps: bool) -> np.ndarray:
    """(H, W, ...) with `left` and `right` more columns: of the other side if the picture wraps, else the outermost."""
    margins = [(0, 0), (left, right)] + [(0, 0)] * (picture.ndim - 2)
    return np.pad(picture, margins, mode="wrap" if wraps else "edge")


def view_rays(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Camera origin (3,) f32 and unit world directions (H, W, 3) f32 of the pixel centres, row 0 on top."""
    columns, rows = np.arange(view.width) + 0.5, np.arange(view.height) + 0.5
    directions = np.empty((view.height, view.width, 3), np.float32)
    for begin in range(0, view.height, ROWS):
        origin, directions[begin:begin + ROWS] = view_rays_at(view, columns, rows[begin:begin + ROWS, None])
    return origin, directions


def view_rays_at(view: View, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Camera origin (3,) f32 and unit world directions (..., 3) f32 at x and y in pixels from the top left corner.

    x and y are broadcast against each other and may lie outside the picture (padding).
    """
    c2w = np.asarray(view.camera_to_world, np.float64)
    if view.panorama is not None:
        directions = view.panorama.directions(x + view.corner[0], y + view.corner[1]) * (np.sign(view.focal[0]), 1, 1)
        return c2w[:3, 3].astype(np.float32), (directions @ c2w[:3, :3].T).astype(np.float32)
    x, y = np.broadcast_arrays((x - view.principal[0]) / view.focal[0], -(y - view.principal[1]) / view.focal[1])
    directions = np.stack([x, y, np.full_like(x, -1.0)], axis=-1) @ c2w[:3, :3].T
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return c2w[:3, 3].astype(np.float32), directions.astype(np.float32)


def clip_distances(view: View, ray: np.ndarray) -> np.ndarray:
    """(P,) f32 lengths of rays (P, 3) of a view before which it sees nothing."""
    if view.panorama is not None:
        return (view.clip_start / np.linalg.norm(ray, axis=1).clip(1e-20)).astype(np.float32)
    depth = -(ray @ view.camera_to_world[:3, 2])
    return np.divide(view.clip_start, depth, out=np.zeros_like(depth), where=depth > 0).astype(np.float32)


def visible_pixels(view: View) -> np.ndarray:
    """(H, W) bool: pixels whose centres show anything: the picture of a fisheye lens is a circle."""
    if view.panorama is None:
        return np.ones((view.height, view.width), bool)
    (x, y), (columns, rows) = view.corner, (np.arange(view.width) + 0.5, np.arange(view.height)[:, None] + 0.5)
    return view.panorama.visible(x + columns, y + rows)


def shift_in_lens(view: View, offset: np.ndarray, distance: float) -> View:
    """The pinhole of a lens point: moved by `offset` (3,) in the world, parallel to the picture.

    Points `distance` world units ahead along the axis, where the lens is focused, keep their position in the picture.
    """
    moved = np.asarray(view.camera_to_world, np.float64).copy()
    right, up, _ = moved[:3, :3].T @ offset
    moved[:3, 3] += offset
    principal = view.principal + view.focal * np.array([right, -up]) / distance
    return replace(view, camera_to_world=moved.astype(np.float32), principal=principal.astype(np.float32))


def square_view(camera_to_world: np.ndarray, fov_degrees: float, resolution: int,
                crop: tuple[int, int, int, int] | None = None) -> View:
    """A square image of `resolution` pixels with full field of view `fov_degrees`, as in the paper's data.

    crop: (y0, x0, height, width) in pixels of that square; the full square when not given.
    """
    y0, x0, height, width = crop or (0, 0, resolution, resolution)
    focal = resolution / 2 / np.tan(np.radians(float(fov_degrees)) / 2)
    return View(np.asarray(camera_to_world, np.float32), np.array([focal, focal], np.float32),
                np.array([resolution / 2 - x0, resolution / 2 - y0], np.float32), int(width), int(height))
