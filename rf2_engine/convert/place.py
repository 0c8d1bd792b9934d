# SPDX-License-Identifier: GPL-3.0-or-later
"""The properties of an instance that a material can read: its place, colour and random number."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .shading.noise.hashing import LARGEST, jenkins


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

    @property
    def random(self) -> float:
        return float(jenkins(self.index, 0) / LARGEST)


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

    @classmethod
    def of(cls, instance, frame: float, asked) -> Place:
        """Copied from a DepsgraphObjectInstance, which lives for one step of the walk alone; asked: Asked."""
        obj = instance.object
        if instance.is_instance:
            random = (instance.random_id & 0xffffffff) / LARGEST
        else:
            random = jenkins(_of_name(obj.name), 0) / LARGEST
        return cls(np.array(instance.matrix_world, np.float64), obj.name, tuple(obj.color), obj.pass_index,
                   float(random), tuple(instance.orco), tuple(instance.uv), _particle(instance, frame),
                   asked.of_object(obj), asked.of_instancer(instance), asked.of_view_layer)


def _particle(instance, frame: float) -> Particle:
    system = instance.particle_system if instance.is_instance else None
    index = instance.persistent_id[0] if system else 0
    if system is None or not 0 <= index < len(system.particles):
        return Particle()
    it = system.particles[index]
    return Particle(index, frame - it.birth_time, it.lifetime, tuple(it.location), it.size, tuple(it.velocity),
                    tuple(it.angular_velocity))


def _of_name(name: str) -> int:
    """Cycles' hash of a string."""
    code = 0
    for byte in name.encode():
        code = (code * 37 + byte - 256 * (byte > 127)) & 0xffffffff
    return code
