# SPDX-License-Identifier: GPL-3.0-or-later
"""A lamp with its position and the directions in which it shines."""
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....model.beams import beam_share
from ..data.blocks import Lamp
from ..data.copied import LampInstance
from .beams import Cone, cones, sphere
from .lamp_power import LampLight

MOST_LIGHT = 0.95  # of a lamp's light is within its half angle
MISPLACED = 0.1    # share of a lamp's light in wrong directions from which on these are a rough guess


@dataclass(frozen=True)
class Detail:
    """The number of triangles of the shapes that replace lamps."""

    ball_faces: int
    disk_corners: int
    shade_sides: int
    most_cells: int  # along one side of an area lamp


class BoundingSphere(NamedTuple):
    """The bounding sphere of the scene, which decides where suns stand and how small lamps may be."""

    center: np.ndarray  # (3,) f64, world
    radius: float       # world units, more than 0

    @classmethod
    def of_box(cls, low: np.ndarray, high: np.ndarray) -> BoundingSphere:
        """The sphere around a box with these corners (3,)."""
        return cls(np.asarray((low + high) / 2, np.float64), max(float(np.linalg.norm(high - low)) / 2, 1e-6))


@dataclass
class PlacedLamp:
    """A lamp's strength, its pose without scale (it shines along -Z), and the scene it stands in."""

    instance: LampInstance
    light_output: LampLight
    report: object
    frame: np.ndarray  # (3, 3) rotation
    scale: np.ndarray  # (3,)
    sphere: BoundingSphere
    detail: Detail
    is_rough_guess: bool = False  # as RenderScene has it

    @property
    def light(self) -> Lamp:
        return self.instance.light

    @property
    def name(self) -> str:
        return self.instance.name

    @property
    def position(self) -> np.ndarray:
        return self.instance.matrix[:3, 3]

    @property
    def strength(self) -> np.ndarray:
        return self.light_output.strength

    def to_world(self, triangles: np.ndarray) -> np.ndarray:
        return triangles @ self.frame.T + self.position

    def approximated(self, message: str) -> None:
        self.report.approximated(self.name, message)

    def guessed(self, message: str) -> None:
        """Its light is not where beams have it."""
        self.is_rough_guess = True
        self.approximated(message)


def beams(lamp: PlacedLamp, own: Cone, facing: bool = False) -> list[Cone]:
    """The beam of a lamp, or cones that approximate what its nodes emit; facing: from a surface, not from a ball."""
    light = lamp.light_output.directions
    if light is None:
        return [own]
    cosine = -sphere(len(light))[:, 2]
    if own.axis.any():
        light = light * beam_share(cosine, own.cosines)[:, None] * (own.strength / np.maximum(lamp.strength, 1e-30))
    fitted, misplaced = cones(light, np.maximum(cosine, 0) if facing else np.ones_like(cosine))
    say = lamp.guessed if misplaced > MISPLACED else lamp.approximated
    say(f"{len(fitted)} cones approximate its light, and {100 * misplaced:.0f} % of it goes in other directions")
    return fitted


def find_half_angle(light: np.ndarray) -> float:
    """Radians around -Z within which nearly all of the light stays."""
    power, cosine = light.mean(axis=1), -sphere(len(light))[:, 2]
    order = np.argsort(-cosine)
    inside = np.searchsorted(np.cumsum(power[order]), MOST_LIGHT * power.sum())
    return math.acos(np.clip(cosine[order[min(inside, len(order) - 1)]], -1, 1))


def rotation(matrix: np.ndarray) -> np.ndarray:
    """(3, 3) orthonormal and right-handed: the lamp's +Z kept, scale, shear and mirror removed."""
    x, z = _unit(matrix[:3, 0]), _unit(matrix[:3, 2])
    z = z if z.any() else np.array([0.0, 0.0, 1.0])
    x = x - z * (x @ z)
    x = _unit(x if np.linalg.norm(x) > 1e-6 else np.cross(z, np.eye(3)[np.abs(z).argmin()]))
    return np.stack([x, np.cross(z, x), z], axis=1)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / (np.linalg.norm(vector) or 1)
