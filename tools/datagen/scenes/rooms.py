# SPDX-License-Identifier: GPL-3.0-or-later
"""Rooms and grounds that scenes stand on.

Rooms are a ground plane with 0 to 3 walls, a wide floor, and open and closed boxes (docs/scene-input.md 1.2). The wide
profile also has small and very large grounds, and scenes that float before the sky.
"""
from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .materials import build_material, mirror_material
from .meshes import add_object

WALLS = {"floor": 0, "wide_floor": 0, "one_wall": 1, "two_walls": 2, "three_walls": 3, "open_box": 3, "closed_box": 4}
CHANCES = {"floor": 0.18, "wide_floor": 0.14, "one_wall": 0.18, "two_walls": 0.18, "three_walls": 0.16,
           "open_box": 0.10, "closed_box": 0.06}

# The wide profile.
SETTINGS = {"room": 0.45, "small ground": 0.15, "large ground": 0.2, "sky": 0.2}
SMALL, LARGE = (0.3, 1.0), (5.0, 10_000.0)  # sides of grounds
TEXTURED, POLISHED = 0.6, 0.1               # chances of a ground
TEXTURE_SIZE = 0.3, 3.0                     # side of one repetition of a texture


@dataclass
class Room:
    """A room around the origin; its open side, where outside cameras stand, is -Y."""

    kind: str
    half: float                      # half of the floor's side; the room is [-half, half]^2 x [floor, floor + height]
    floor: float
    height: float
    surfaces: list[bpy.types.Object]

    @property
    def has_ceiling(self) -> bool:
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
    """A room of one of the kinds, by its chance."""
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
    surfaces = [add_plane(f"side {i}", rng, *side) for i, side in enumerate(sides)]
    return Room(kind, half, floor, height, surfaces)


def build_setting(rng: np.random.Generator) -> Room:
    """One of SETTINGS with its materials; without walls it is a "floor", which before the sky has no surface."""
    kind = str(rng.choice(list(SETTINGS), p=list(SETTINGS.values())))
    if kind == "room":
        room = build_room(rng)
        for surface in room.surfaces:
            surface.data.materials.append(build_material(rng, "full", "room"))
        return room
    if kind == "sky":
        return Room("floor", 0.6, -0.5, 1.0, [])
    low, high = np.log(SMALL if kind == "small ground" else LARGE)
    return build_ground(rng, np.exp(rng.uniform(low, high)) / 2)


def build_ground(rng: np.random.Generator, half: float) -> Room:
    """A square of side 2 `half`, half a unit below the origin."""
    floor, (right, deep) = -0.5, 2 * half * np.eye(3)[:2]
    ground = add_plane("side 0", rng, np.array([-half, -half, floor]), right, deep)
    style = rng.uniform()
    if style < TEXTURED:
        ground.data.materials.append(build_material(rng, "full", "room", "textured_dielectric"))
        repeat_textures(ground.data, 2 * half / rng.uniform(*TEXTURE_SIZE))
    elif style < TEXTURED + POLISHED:
        ground.data.materials.append(mirror_material(rng))
    else:
        ground.data.materials.append(build_material(rng, "full", "room"))
    return Room("floor", half, floor, 1.0, [ground])


def repeat_textures(mesh: bpy.types.Mesh, times: float) -> None:
    """Let the textures of a mesh repeat so often along both sides."""
    uv = np.empty(2 * len(mesh.loops), np.float32)
    layer = mesh.uv_layers[0].uv
    layer.foreach_get("vector", uv)
    layer.foreach_set("vector", uv * np.float32(times))


def add_plane(name: str, rng: np.random.Generator, corner: np.ndarray, u: np.ndarray,
              v: np.ndarray) -> bpy.types.Object:
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
    return add_object(name, mesh)
