# SPDX-License-Identifier: GPL-3.0-or-later
"""The copy of a Blender scene that a conversion works on: arrays and plain objects, for any thread."""
from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from .blocks import Lamp, Material, World
from .instance import Place
from .mesh import TriangleMesh


@dataclass(eq=False)
class Surface:
    """An evaluated mesh with its materials, or hair or points as a mesh; what is alike wherever it stands."""

    source: int                   # what the mesh was read from
    mesh: TriangleMesh
    slots: list[Material | None]
    mirrored: bool
    is_shown: bool                # to the camera
    is_dark: bool                 # shines on nothing that is there
    is_diced: bool = False
    strands_slot: int | None = None  # of hair or points: the only material's; None: a mesh


@dataclass
class Grid:
    """Value i of an axis holds over [i, i + 1], as Cycles draws voxels."""

    values: np.ndarray    # (x, y, z, c) f32
    to_space: np.ndarray  # (4, 4) f64, from places counted in values: to the object's, or to the world's

    def moved(self, matrix: np.ndarray) -> Grid:
        return replace(self, to_space=matrix @ self.to_space)

    def corners(self) -> np.ndarray:
        """(8, 3) of what it fills, counted in values."""
        return np.indices((2, 2, 2)).reshape(3, 8).T * np.array(self.values.shape[:3])


@dataclass(frozen=True)
class Gridded:
    """A Volume object or simulated gas in its place."""

    name: str
    material: Material | None
    place: Place
    box: np.ndarray                # (8, 3) f32 corners, in the frame of the object
    grids: dict[str, Grid] | None  # None: they could not be read
    apart: bool                    # coefficients are per world unit; else in the frame of the object


@dataclass(frozen=True)
class LampInstance:
    """One lamp, as bright as its data-block says and wherever it stands."""

    name: str           # of the object
    matrix: np.ndarray  # (4, 4) f64, object to world
    light: Lamp


@dataclass(frozen=True)
class Sun:
    """Light from far away, the same wherever it falls."""

    toward: np.ndarray      # (3,) unit, world
    irradiance: np.ndarray  # (3,) of a surface that faces it
    angle: float            # radians, its diameter


@dataclass
class Copied:
    world: World | None
    drawn: tuple[np.ndarray | None, list[Sun]] | None  # the world's panorama and suns, where Cycles had to draw them
    things: list[tuple[Surface, Place] | Gridded] = field(default_factory=list)  # in the order of the instances
    lamps: list[LampInstance] = field(default_factory=list)
    clip_start: float = 0.0  # of the camera, world units along its axis
