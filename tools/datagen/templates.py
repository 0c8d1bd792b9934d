# SPDX-License-Identifier: GPL-3.0-or-later
"""Room templates: a ground plane with 0 to 3 walls, a wide floor, open and closed boxes (docs/scene-input.md 1.2)."""
from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

WALLS = {"floor": 0, "wide_floor": 0, "one_wall": 1, "two_walls": 2, "three_walls": 3, "open_box": 3, "closed_box": 4}
CHANCES = {"floor": 0.18, "wide_floor": 0.14, "one_wall": 0.18, "two_walls": 0.18, "three_walls": 0.16,
           "open_box": 0.10, "closed_box": 0.06}


@dataclass
class Room:
    """A room around the origin; its open side, where outside cameras stand, is -Y."""

    kind: str
    half: float                      # half of the floor's side; the room is [-half, half]^2 x [floor, floor + height]
    floor: float
    height: float
    surfaces: list[bpy.types.Object]

    @property
    def enclosed(self) -> bool:
        """Lamps must be inside, because a ceiling keeps the others out."""
        return self.kind.endswith("_box")

    @property
    def spread(self) -> float:
        """Largest azimuth of an outside camera from -Y, radians, before a wall hides the scene."""
        return {0: np.pi, 1: 1.2, 2: 0.7, 3: 0.45, 4: 0.0}[self.walls]

    @property
    def walls(self) -> int:
        return WALLS[self.kind]


def build_room(rng: np.random.Generator, chances: dict[str, float] = CHANCES) -> Room:
    """A room of one of the kinds, by the chance of each."""
    kind = str(rng.choice(list(chances), p=list(chances.values())))
    half = 0.5 * rng.uniform(0.9, 1.35) * (rng.uniform(1.5, 2.5) if kind == "wide_floor" else 1.0)
    height = 2 * half * (rng.uniform(0.75, 1.0) if kind.endswith("_box") else rng.uniform(0.5, 1.0))
    floor = -0.5
    right, deep, up = np.eye(3) * (2 * half, 2 * half, height)
    corner = np.array([-half, -half, floor])
    sides = [(corner, right, deep)]
    walls = [(corner + deep, right, up), (corner, deep, up), (corner + right + deep, -deep, up),
             (corner + right, -right, up)]
    sides += walls[:WALLS[kind]]
    if kind.endswith("_box"):
        sides.append((corner + up + deep, right, -deep))
    surfaces = [plane(f"side {i}", rng, *side) for i, side in enumerate(sides)]
    return Room(kind, half, floor, height, surfaces)


def plane(name: str, rng: np.random.Generator, corner: np.ndarray, u: np.ndarray, v: np.ndarray) -> bpy.types.Object:
    """About 128 triangles over the parallelogram corner + [0,1] u + [0,1] v, facing u x v, UV covering [0,1]^2."""
    n = int(rng.integers(6, 10))
    grid = np.stack(np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="xy"), -1).reshape(-1, 2) / n
    if rng.uniform() < 0.3:  # uneven triangles: the network must not learn the raster of the floor
        inner = ((grid > 0) & (grid < 1)).all(axis=1, keepdims=True)
        grid = grid + inner * rng.uniform(-0.3, 0.3, grid.shape) / n
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = first[:, None] + np.array([0, 1, n + 2, n + 1])
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corner + grid @ np.stack([u, v]), [], quads)
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", grid[quads.ravel()].astype(np.float32).ravel())
    surface = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(surface)
    return surface
