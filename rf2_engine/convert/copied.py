# SPDX-License-Identifier: GPL-3.0-or-later
"""The copy of a Blender scene that a conversion works on: arrays and plain objects, for any thread."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .lamps.suns import Sun
from .media.grids import Grid
from .meshes.mesh import TriangleMesh
from .place import Place
from .shading.blocks import Lamp, Material, World


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


@dataclass
class Copied:
    world: World | None
    drawn: tuple[np.ndarray | None, list[Sun]] | None  # the world's panorama and suns, where Cycles had to draw them
    things: list[tuple[Surface, Place] | Gridded] = field(default_factory=list)  # in the order of the instances
    lamps: list[LampInstance] = field(default_factory=list)
    clip_start: float = 0.0  # of the camera, world units along its axis
