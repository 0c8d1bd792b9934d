# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper profile: scenes as the paper's section "Training Data" has them, of any number of triangles.

What differs: rooms are never glass (docs/scene-input.md 3.3), nor are objects that are not closed; panoramas are as
bright as suits the lamps. Objects, maps and panoramas are built in, or come from the user's folders (own_files.py).
"""
from __future__ import annotations

import bpy
import numpy as np

from .cameras import Setup, build_cameras
from .lights import build_lights
from .materials import set_inputs
from .media import build_volume
from .objects import build_objects
from .paper_materials import build_paper_material, is_closed
from .rooms import Room, build_room
from .worlds import build_world

ROOMS = dict.fromkeys(("floor", "one_wall", "two_walls", "three_walls"), 0.25)
TRIANGLES, RESOLUTION = 1024, 256  # of the paper's first stage
ROOM_TRIANGLES = 512               # of the budget, about, at most half
LIT_BY_WORLD = 5 / 6
VOLUMES = 1 / 3, 1 / 3, 1 / 3      # none, one, two
LIGHTS = 8                         # at most
RADIANCE = 2500.0, 5000.0          # W/m^2 of a channel of all lights together
DISTANCE = 2.1, 2.7


def build(rng: np.random.Generator, views: int, triangles: int = TRIANGLES) -> Setup | None:
    """A scene in the empty open file, or None when it has no good view."""
    room = build_room(rng, ROOMS)
    for surface in room.surfaces:
        surface.data.materials.append(build_paper_material(rng, "room"))
    object_triangles = triangles - min(ROOM_TRIANGLES, triangles // 2)
    for item in build_objects(rng, room, int(rng.integers(1, 4)), object_triangles, fill=True):
        item.data.materials.append(build_paper_material(rng, "object", closed=is_closed(item.data)))
    bpy.context.view_layer.update()
    cameras = build_cameras(rng, room, views)
    if cameras is None:
        return None
    for i in range(int(rng.choice(3, p=VOLUMES))):
        build_volume(rng, room, f"volume {i}")
    irradiance = 3.0 * np.exp(rng.normal(0.0, 0.35))
    lit = rng.uniform() < LIT_BY_WORLD
    build_world(rng, "hdri" if lit else "none", rng.uniform(0.2, 0.8) * irradiance / np.pi)
    build_paper_lights(rng, room, int(rng.integers(1, LIGHTS + 1)))
    return Setup(cameras, triangles, RESOLUTION)


def build_paper_lights(rng: np.random.Generator, room: Room, count: int) -> None:
    """`count` triangles outside the room that no camera sees and that share RADIANCE."""
    build_lights(rng, room, count, 1.0, kind="triangle")
    for i in range(count):
        light, radiance = bpy.data.objects[f"light {i}"], rng.uniform(*RADIANCE, 3) / count
        light.location *= rng.uniform(*DISTANCE) / light.location.length
        light.visible_camera = False
        set_inputs(light.data.materials[0], {"Emission Color": radiance / radiance.max(),
                                             "Emission Strength": radiance.max()})
