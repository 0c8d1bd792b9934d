# SPDX-License-Identifier: GPL-3.0-or-later
"""The projections of Cycles' panoramic cameras: from a position in the picture to a direction.

All functions of PROJECTIONS take u, v in [0, 1] from the left and from the bottom of the picture, and their parameters.
They return right, up, forward of directions in the camera's frame, of any length, and whether the camera sees anything
there. Directions are defined outside of what it sees too, because a network needs one for every pixel.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RASTER = 32                   # positions along either side at which `shows_something` looks
FULL_TURN = 2 * np.pi - 1e-3  # radians from which a picture meets itself at its sides


@dataclass(frozen=True)
class Panorama:
    """A projection, for pictures of `width` x `height` pixels."""

    kind: str                    # of PROJECTIONS
    width: int
    height: int
    numbers: tuple[float, ...]   # further parameters of that function
    shift: tuple[float, float]   # of u and v

    def directions(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(..., 3) f64 unit directions in camera space (right, up, backward) at pixels from the top left corner."""
        right, up, forward = self._project(x, y)[0]
        directions = np.stack([right, up, -forward], axis=-1)
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def visible(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(...) bool: whether the camera sees anything there."""
        return self._project(x, y)[1]

    @property
    def pixels_per_radian(self) -> float:
        """In the middle of the picture, along the vertical."""
        below, above = self.directions(np.full(2, self.width / 2), self.height / 2 + np.array([0.5, -0.5]))
        return float(1 / (2 * np.arcsin(np.linalg.norm(above - below) / 2)))

    @property
    def shows_something(self) -> bool:
        """False for angles that make an empty picture."""
        x, y = np.meshgrid(*((np.arange(RASTER) + 0.5) / RASTER * side for side in (self.width, self.height)))
        with np.errstate(all="ignore"):
            return bool(np.isfinite(self.pixels_per_radian) and np.isfinite(self.directions(x, y)).all()
                        and self.visible(x, y).any())

    @property
    def wraps(self) -> bool:
        """Whether the left and the right side of the picture are neighbours."""
        turns = self.kind in ("EQUIRECTANGULAR", "CENTRAL_CYLINDRICAL")
        return turns and abs(self.numbers[1] - self.numbers[0]) >= FULL_TURN

    def _project(self, x: np.ndarray, y: np.ndarray) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        u, v = x / self.width + self.shift[0], 1 - y / self.height + self.shift[1]
        (right, up, forward), is_visible = PROJECTIONS[self.kind](u, v, *self.numbers)
        return np.broadcast_arrays(right, up, forward), np.broadcast_to(is_visible, x.shape)


def equirectangular(u, v, west: float, east: float, south: float, north: float):
    longitude, latitude = west + u * (east - west), south + v * (north - south)
    return (np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)), True


def central_cylindrical(u, v, west: float, east: float, low: float, high: float):
    """low, high: on a cylinder of radius 1."""
    longitude = west + u * (east - west)
    return (np.sin(longitude), low + v * (high - low), np.cos(longitude)), True


def equiangular_cube_face(u, v):
    return (np.tan((u - 0.5) * np.pi / 2), np.tan((v - 0.5) * np.pi / 2), np.ones_like(u)), True


def mirror_ball(u, v):
    x, y = 2 * u - 1, 2 * v - 1
    height = np.sqrt((1 - x * x - y * y).clip(0))  # of the ball, towards a distant viewer
    return (2 * height * x, 2 * height * y, 2 * height ** 2 - 1), x * x + y * y <= 1


def fisheye_equidistant(u, v, field_of_view: float):
    x, y = 2 * u - 1, 2 * v - 1
    radius = np.hypot(x, y)
    return _turn_from_axis(x, y, radius * field_of_view / 2), radius <= 1


def fisheye_equisolid(u, v, lens: float, field_of_view: float, width: float, height: float):
    """lens, width, height: of the sensor, mm."""
    x, y = (u - 0.5) * width, (v - 0.5) * height
    radius = np.hypot(x, y)
    angle = 2 * np.arcsin((radius / (2 * lens)).clip(max=1))
    return _turn_from_axis(x, y, angle), radius <= 2 * lens * np.sin(field_of_view / 4)


def fisheye_polynomial(u, v, field_of_view: float, width: float, height: float, *coefficients: float):
    """coefficients: of the powers of the distance from the middle of the sensor, mm, from 0 on."""
    x, y = (u - 0.5) * width, (v - 0.5) * height
    angle = -np.polynomial.polynomial.polyval(np.hypot(x, y), coefficients)
    return _turn_from_axis(x, y, angle), np.abs(angle) <= field_of_view / 2


def _turn_from_axis(x, y, angle) -> tuple[np.ndarray, ...]:
    """The direction `angle` radians away from the axis, towards x, y."""
    radius = np.hypot(x, y)
    share = np.sin(angle) / np.where(radius > 0, radius, 1)
    return x * share, y * share, np.cos(angle)


PROJECTIONS = {
    "EQUIRECTANGULAR": equirectangular,
    "CENTRAL_CYLINDRICAL": central_cylindrical,
    "EQUIANGULAR_CUBEMAP_FACE": equiangular_cube_face,
    "MIRRORBALL": mirror_ball,
    "FISHEYE_EQUIDISTANT": fisheye_equidistant,
    "FISHEYE_EQUISOLID": fisheye_equisolid,
    "FISHEYE_LENS_POLYNOMIAL": fisheye_polynomial,
}
