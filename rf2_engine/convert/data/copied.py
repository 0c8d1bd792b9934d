# SPDX-License-Identifier: GPL-3.0-or-later
"""The copy of a Blender scene that a conversion works on: arrays and plain objects, for any thread."""
from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ....model.scene import ALL_GROUPS, ANY, BOUNCES
from ....model.surface_kinds import Ray
from .arrays import UNIT_CUBE
from .blocks import Lamp, Material, World
from .mesh import TriangleMesh


class Reach(NamedTuple):
    """Where the light of a lamp, or of the world, goes (RenderScene: hidden, light_bounces, lit_groups, blockers)."""

    hidden: int = 0           # rays that do not see it, a set of Ray
    bounces: int = ANY
    groups: int = ALL_GROUPS  # of surfaces, bits
    blockers: int = ALL_GROUPS  # of surfaces that stop it, bits


@dataclass(eq=False)
class CopiedMesh:
    """An evaluated mesh with its materials, or hair or points as a mesh; the same for all instances."""

    source: int                   # what the mesh was read from
    mesh: TriangleMesh
    slots: list[Material | None]
    mirrored: bool
    hidden: int                   # rays that do not meet it, a set of Ray
    is_dark: bool                 # by light linking it lights nothing that is visible
    is_diced: bool = False
    lit_groups: int = ALL_GROUPS  # of surfaces, bits, if it shines
    blockers: int = ALL_GROUPS    # of surfaces that stop its light
    strands_slot: int | None = None  # of hair or points: the only material's; None: a mesh
    real: TriangleMesh | None = None  # of hair or points, of which `mesh` is a sample: what rays meet

    @property
    def is_shown(self) -> bool:
        """Whether cameras see it."""
        return not self.hidden & Ray.CAMERA

    @property
    def real_mesh(self) -> TriangleMesh:
        """What rays meet."""
        return self.mesh if self.real is None else self.real

    def find_slots(self, mesh: TriangleMesh) -> np.ndarray:
        """(n,) index in `slots` of each triangle of a mesh made of this one; as in Blender the last beyond the end."""
        if self.strands_slot is not None:
            return np.full(len(mesh), self.strands_slot)
        return mesh.slot.clip(0, len(self.slots) - 1)


@dataclass
class Grid:
    """Value i of an axis holds over [i, i + 1], as Cycles draws voxels."""

    values: np.ndarray    # (x, y, z, c) f32
    to_space: np.ndarray  # (4, 4) f64, from indices of values to the object's, or to the world's

    def moved(self, matrix: np.ndarray) -> Grid:
        return replace(self, to_space=matrix @ self.to_space)

    def corners(self) -> np.ndarray:
        """(8, 3) corners, in indices of values."""
        return UNIT_CUBE * np.array(self.values.shape[:3])


@dataclass(frozen=True)
class CopiedVolume:
    """An instance of a Volume object or of simulated gas."""

    name: str
    material: Material | None
    instance: Instance
    box: np.ndarray                # (8, 3) f32 corners, in the frame of the object
    grids: dict[str, Grid] | None  # None: they could not be read
    is_per_world_unit: bool        # coefficients are; else they are in the frame of the object


@dataclass(frozen=True)
class LampInstance:
    """An instance of a lamp."""

    name: str           # of the object
    matrix: np.ndarray  # (4, 4) f64, object to world
    light: Lamp
    reach: Reach = Reach()
    light_group: int = 0  # from 1; 0 = none


@dataclass(frozen=True)
class Sun:
    """Light from far away, the same wherever it falls."""

    toward: np.ndarray      # (3,) unit, world
    irradiance: np.ndarray  # (3,) of a surface that faces it
    angle: float            # radians, its diameter
    reach: Reach = Reach()
    light_group: int = 0


@dataclass
class CopiedScene:
    world: World | None
    # And suns, by the rays that see them, of a world that Cycles had to render
    world_panoramas: dict[Ray, tuple[np.ndarray, list[Sun]]] | None
    objects: list[tuple[CopiedMesh, Instance] | CopiedVolume] = field(default_factory=list)  # in their order
    lamps: list[LampInstance] = field(default_factory=list)
    bounces: tuple[int, ...] = BOUNCES
    caustics: tuple[bool, bool] = True, True  # reflective, refractive
    world_light_group: int = 0


@dataclass(frozen=True)
class ConversionOptions:
    """How a scene becomes tokens."""

    token_budget: int  # most triangles of the result, of which lamps take no more than half
    max_edge: float    # longest edge, a fraction of the longest side of the scene's box; farther away it may be longer
    as_is: bool = False  # one unit of the world is one of the network's, around its origin; light keeps its strength
    paper_lamps: bool = False  # each lamp becomes one small triangle (lamps/one_triangle.py)
    keeps_lobes: bool = False  # the network shows the two lobes of a Diffuse and a Glossy BSDF that are added


@dataclass(frozen=True)
class Particle:
    """The particle of an instance; without one, values are those of the first particle, at rest."""

    index: int = 0
    age: float = 0.0       # frames
    lifetime: float = 0.0
    location: tuple = (0.0, 0.0, 0.0)
    size: float = 0.0
    velocity: tuple = (0.0, 0.0, 0.0)
    angular_velocity: tuple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Instance:
    """One instance of an object."""

    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))  # (4, 4) f64, object to world
    name: str = ""
    color: tuple = (1.0, 1.0, 1.0, 1.0)
    index: int = 0
    random: float = 0.0
    generated: tuple = (0.0, 0.0, 0.0)  # of the instancer at the instance
    uv: tuple = (0.0, 0.0)
    particle: Particle = Particle()
    properties: dict = field(default_factory=dict)  # numbers and vectors that materials read, by name
    instancer_properties: dict = field(default_factory=dict)
    view_layer_properties: dict = field(default_factory=dict)
    light_group: int = 0  # from 1; 0 = none
    # (4, 4) each, of the instances that this one's tokens stand for; none: of this one alone
    real_matrices: tuple[np.ndarray, ...] = ()
    group: int = 0  # of surfaces, as lights are linked to
    is_holdout: bool = False  # it cuts a hole into the film
