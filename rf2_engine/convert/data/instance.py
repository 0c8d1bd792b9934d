# SPDX-License-Identifier: GPL-3.0-or-later
"""The properties of an instance that a material can read: its place, colour and random number."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Particle:
    """The particle that an instance stands for; an instance of none is like the first one, at rest."""

    index: int = 0
    age: float = 0.0       # frames
    lifetime: float = 0.0
    location: tuple = (0.0, 0.0, 0.0)
    size: float = 0.0
    velocity: tuple = (0.0, 0.0, 0.0)
    angular_velocity: tuple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Place:
    """One instance of an object."""

    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))  # (4, 4) f64, object to world
    name: str = ""
    color: tuple = (1.0, 1.0, 1.0, 1.0)
    index: int = 0
    random: float = 0.0
    generated: tuple = (0.0, 0.0, 0.0)  # coordinates of the instancer where it puts the instance
    uv: tuple = (0.0, 0.0)
    particle: Particle = Particle()
    properties: dict = field(default_factory=dict)  # numbers and vectors that materials ask for, by name
    of_instancer: dict = field(default_factory=dict)
    of_view_layer: dict = field(default_factory=dict)
