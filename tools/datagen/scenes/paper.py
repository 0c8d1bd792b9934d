# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper profile: scenes as the paper's section "Training Data" has them, of any number of triangles.

What differs: rooms are never glass (docs/scene-input.md 3.3); roughness is log-uniform for a third of the materials
only; lamps' power follows from the irradiance that they shall bring, so that no picture is black or burnt out. Objects,
maps and panoramas are built in, or come from the user's folders (own_files.py).
"""
from __future__ import annotations

import bpy
import numpy as np

from .cameras import Setup, build_cameras
from .lights import build_lights
from .materials import build_material
from .media import build_volume
from .objects import build_objects
from .rooms import build_room
from .worlds import build_world

ROOMS = dict.fromkeys(("floor", "one_wall", "two_walls", "three_walls"), 0.25)
TRIANGLES, RESOLUTION = 1024, 256  # of the paper's first stage
ROOM_TRIANGLES = 512               # of the budget, about, at most half
LIT_BY_WORLD = 5 / 6
VOLUMES = 1 / 3, 1 / 3, 1 / 3      # none, one, two
LIGHTS = 8                         # at most


def build(rng: np.random.Generator, views: int, triangles: int = TRIANGLES) -> Setup | None:
    """A scene in the empty open file, or None when it has no good view."""
    room = build_room(rng, ROOMS)
    for surface in room.surfaces:
        surface.data.materials.append(build_material(rng, "paper", "room"))
    object_triangles = triangles - min(ROOM_TRIANGLES, triangles // 2)
    for item in build_objects(rng, room, int(rng.integers(1, 4)), object_triangles, fill=True):
        item.data.materials.append(build_material(rng, "paper", "object"))
    bpy.context.view_layer.update()
    cameras = build_cameras(rng, room, views)
    if cameras is None:
        return None
    for i in range(int(rng.choice(3, p=VOLUMES))):
        build_volume(rng, room, f"volume {i}")
    irradiance = 3.0 * np.exp(rng.normal(0.0, 0.35))
    share = rng.uniform(0.2, 0.8) if rng.uniform() < LIT_BY_WORLD else 0.0
    build_world(rng, "hdri" if share else "none", share * irradiance / np.pi)
    build_lights(rng, room, int(rng.integers(1, LIGHTS + 1)), (1 - share) * irradiance, kind="triangle")
    return Setup(cameras, triangles, RESOLUTION)
