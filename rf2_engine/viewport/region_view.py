# SPDX-License-Identifier: GPL-3.0-or-later
"""What a 3D viewport looks at, as numbers, and the `View` (model/scene.py) of a picture of it."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...model.scene import View
from ..convert.camera.camera import rigid
from ..convert.camera.orthographic import DEPTHS, DISTANCE

Matrix = tuple[tuple[float, ...], ...]
Rectangle = tuple[int, int, int, int]
ALL = (0.0, 1.0, 0.0, 1.0)
STEP = 64  # pixels: coarse pictures have multiples of them, because the network does no less for others


@dataclass(frozen=True)
class RegionView:
    """Where a region of a 3D viewport looks; equal ones show the same."""

    projection: Matrix      # (4, 4) camera space to clip space of the region, lens shift and zoom of the view included
    camera: Matrix          # (4, 4) camera to world
    rectangle: Rectangle    # pixels (x0, x1, y0, y1) of the region, from its bottom left, that are drawn
    size: tuple[int, int]   # pixels of the region
    pixel_size: int = 1     # pixels of the screen along a side of one pixel of the finest picture

    @classmethod
    def read(cls, width: int, height: int, data, space, scene, interface_pixel: float = 1.0) -> RegionView:
        """Read it from the size of a region in pixels, its RegionView3D and SpaceView3D, and the scene.

        interface_pixel: `preferences.system.pixel_size`.
        """
        projection, view = np.array(data.window_matrix), np.array(data.view_matrix)
        part = ALL
        if data.view_perspective == "CAMERA" and space.camera is not None:
            if scene.render.use_border and space.camera.type == "CAMERA":
                frame = _camera_frame(projection, space.camera, scene)
                part = _inside(frame, _border(scene.render, "border"))
        elif space.use_render_border:
            part = _border(space, "render_border")
        pixels = np.array([width, width, height, height])
        x0, x1, y0, y1 = np.rint(np.clip(part, 0, 1) * pixels).astype(int).tolist()
        setting = scene.render.preview_pixel_size
        pixel_size = (2 if interface_pixel > 1.5 else 1) if setting == "AUTO" else int(setting)
        return cls(_frozen(projection), _frozen(np.linalg.inv(view)), (x0, max(x1, x0), y0, max(y1, y0)),
                   (width, height), pixel_size)

    @property
    def is_empty(self) -> bool:
        x0, x1, y0, y1 = self.rectangle
        return x1 <= x0 or y1 <= y0

    @property
    def is_orthographic(self) -> bool:
        return self.projection[3][3] == 1

    def picture_size(self, divisor: int) -> tuple[int, int]:
        """Width and height of a picture with about 1 / divisor of the resolution."""
        x0, x1, y0, y1 = self.rectangle
        sides = (max(round(length / self.pixel_size / divisor), 1) for length in (x1 - x0, y1 - y0))
        return tuple(round(side / STEP) * STEP if divisor > 1 and side > STEP else side for side in sides)

    def view(self, divisor: int, points: np.ndarray, longer_side: int = 0) -> View:
        """The View of a picture of `picture_size(divisor)`.

        points: (k, 3) of the scene, world, so that an orthographic view is from behind all that it shows.
        longer_side: as in View.
        Raises SceneError for a camera that shows nothing.
        """
        projection, (width, height) = np.array(self.projection), self.size
        camera_to_world, mirror = rigid(np.array(self.camera), "Viewport", None)
        clip_start = 0.0 if self.is_orthographic else projection[2, 3] / (projection[2, 2] - 1)
        if self.is_orthographic:
            projection = _as_perspective(projection, camera_to_world, points)
        scale = np.array([projection[0, 0] * mirror, projection[1, 1]])
        shift = np.array([-projection[0, 2], projection[1, 2]])
        half = np.array([width, height]) / 2
        x0, x1, y0, y1 = self.rectangle
        picture_width, picture_height = self.picture_size(divisor)
        scale_down = np.array([picture_width / (x1 - x0), picture_height / (y1 - y0)])
        principal = ((1 + shift) * half - (x0, height - y1)) * scale_down
        return View(camera_to_world.astype(np.float32), (scale * half * scale_down).astype(np.float32),
                    principal.astype(np.float32), picture_width, picture_height, longer_side,
                    clip_start=float(clip_start))


def _as_perspective(projection: np.ndarray, camera_to_world: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The matrix of a distant camera in place of an orthographic one, which is moved back in place.

    As in orthographic.py, but by points of the whole scene: what is in the picture may change with every redraw.
    """
    to_clip_space = projection @ np.linalg.inv(camera_to_world)
    across = points @ to_clip_space[:2, :3].T + to_clip_space[:2, 3]
    inside = points[(np.abs(across) <= 1).all(axis=1)]
    heights = ((inside if len(inside) else points) - camera_to_world[:3, 3]) @ camera_to_world[:3, 2]
    low, high = (heights.min(), heights.max()) if len(heights) else (0.0, 0.0)
    frame = 2 / min(abs(projection[0, 0]), abs(projection[1, 1]))
    distance = max(DISTANCE * frame, DEPTHS * (high - low))
    camera_to_world[:3, 3] += (distance + (low + high) / 2) * camera_to_world[:3, 2]
    perspective = np.zeros((4, 4))
    perspective[0, 0], perspective[1, 1] = projection[0, 0] * distance, projection[1, 1] * distance
    perspective[:2, 2] = -projection[:2, 3]
    return perspective


def _camera_frame(projection: np.ndarray, camera, scene) -> np.ndarray:
    """(4,) x0, x1, y0, y1 of the camera's picture, in parts of the region."""
    corners = np.array([(*corner, 1) for corner in camera.data.view_frame(scene=scene)]) @ projection.T
    positions = (corners[:, :2] / corners[:, 3:] + 1) / 2
    return np.stack([positions.min(axis=0), positions.max(axis=0)], axis=1).ravel()


def _inside(frame: np.ndarray, part: tuple[float, ...]) -> np.ndarray:
    """A part of a rectangle, as parts of what it is a part of."""
    low, length = frame[[0, 0, 2, 2]], np.repeat([frame[1] - frame[0], frame[3] - frame[2]], 2)
    return low + length * part


def _border(owner, name: str) -> tuple[float, ...]:
    return tuple(getattr(owner, f"{name}_{end}") for end in ("min_x", "max_x", "min_y", "max_y"))


def _frozen(matrix: np.ndarray) -> Matrix:
    return tuple(map(tuple, matrix.tolist()))
