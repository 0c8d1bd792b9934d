# SPDX-License-Identifier: GPL-3.0-or-later
"""Grounds of the wide profile's scenes: in a room, on a small or a very large ground, or before the sky."""
from __future__ import annotations

import bpy
import numpy as np

from .materials import build_material
from .mirrors import mirror_material
from .templates import Room, build_room, plane

PLACES = {"room": 0.45, "small ground": 0.15, "large ground": 0.2, "sky": 0.2}
SMALL, LARGE = (0.3, 1.0), (5.0, 10_000.0)  # sides
TEXTURED, POLISHED = 0.6, 0.1               # chances of a ground
REPEATS = 0.3, 3.0                          # side of one repetition of a texture


def build_place(rng: np.random.Generator) -> Room:
    """One of PLACES with its materials; without walls it is a "floor", which before the sky has no surface."""
    kind = str(rng.choice(list(PLACES), p=list(PLACES.values())))
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
    ground = plane("side 0", rng, np.array([-half, -half, floor]), right, deep)
    style = rng.uniform()
    if style < TEXTURED:
        ground.data.materials.append(build_material(rng, "full", "room", "textured_dielectric"))
        repeat(ground.data, 2 * half / rng.uniform(*REPEATS))
    elif style < TEXTURED + POLISHED:
        ground.data.materials.append(mirror_material(rng))
    else:
        ground.data.materials.append(build_material(rng, "full", "room"))
    return Room("floor", half, floor, 1.0, [ground])


def repeat(mesh: bpy.types.Mesh, times: float) -> None:
    """Let the textures of a mesh repeat so often along both sides."""
    uv = np.empty(2 * len(mesh.loops), np.float32)
    layer = mesh.uv_layers[0].uv
    layer.foreach_get("vector", uv)
    layer.foreach_set("vector", uv * np.float32(times))
