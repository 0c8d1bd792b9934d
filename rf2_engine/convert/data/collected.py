# SPDX-License-Identifier: GPL-3.0-or-later
"""The contents of a scene: meshes and their instances, lamps, media."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ....model.scene import ALL_GROUPS
from .arrays import UNIT_CUBE
from .copied import Instance, LampInstance
from .medium import Medium
from .mesh import TriangleMesh


@dataclass
class Part:
    """One mesh with its materials and all its instances. Emitting triangles are a part of their own."""

    name: str
    mesh: TriangleMesh
    materials: list
    emits: bool
    is_shown: bool                                             # to the camera
    instances: list[Instance] = field(default_factory=list)
    is_textured: bool = False                                  # materials vary across triangles
    flux_gain: float | np.ndarray = 1.0                        # for area lost to simplification, or (n,); 0: dark
    real: TriangleMesh | None = None                           # the mesh before it was simplified or divided
    hidden: int = 0                                            # rays that do not meet it, a set of Ray
    lit_groups: int = ALL_GROUPS                               # of surfaces, bits, if it shines
    blockers: int = ALL_GROUPS                                 # of surfaces that stop its light
    token: np.ndarray | None = None                            # (n,) i32 triangle of `mesh` for each one of `real`

    @property
    def matrices(self) -> list[np.ndarray]:
        """(4, 4) f64 each, object to world."""
        return [instance.matrix for instance in self.instances]


@dataclass
class CollectedScene:
    parts: list[Part] = field(default_factory=list)
    lamps: list[LampInstance] = field(default_factory=list)
    media: list[Medium] = field(default_factory=list)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest world coordinates (3,) of surfaces and media; a unit cube if there are none.

        Surfaces that shine count only where there is nothing else: they may stand far away, as lamps do.
        """
        points = [medium.box.corners() for medium in self.media]
        for part in [part for part in self.parts if not part.emits] or ([] if points else self.parts):
            points += _boxes(part)
        if not points:
            return np.full(3, -0.5), np.full(3, 0.5)
        points = np.concatenate(points)
        return points.min(axis=0), points.max(axis=0)

    def beyond(self, box: np.ndarray) -> list[str]:
        """Names of the surfaces that reach farther outside a box (2, 3) than it is wide."""
        low, high = box
        room = (high - low).max() + 1e-6
        names = {}
        for part in self.parts:
            for corners in _boxes(part):
                if (corners.min(axis=0) < low - room).any() or (corners.max(axis=0) > high + room).any():
                    names[part.name] = None
        return list(names)


def _boxes(part: Part) -> list[np.ndarray]:
    """(8, 3) world corners of the bounding box of each instance."""
    low, high = part.mesh.bounds
    corners = low + UNIT_CUBE * (high - low).astype(np.float64)
    return [corners @ matrix[:3, :3].T + matrix[:3, 3] for matrix in part.matrices]
