# SPDX-License-Identifier: GPL-3.0-or-later
"""The wide profile: what people build beside furnished rooms, with the chance of everything in one place.

Rooms as in the full profile, small and very large grounds, and objects that float before the sky (rooms.py); thin
panels and screens that shine (lights.py); mirrors and clear glass before the objects (objects.py); smoke and fog
(media.py); Sky Textures, sun lamps and made-up panoramas (worlds.py); near and far cameras with any lens (cameras.py);
2,000 to 16,000 triangles.
"""
from __future__ import annotations

import bpy
import numpy as np

from .cameras import Setup, build_wide_cameras
from .lights import build_lights, build_panel
from .materials import build_material
from .media import build_fog, build_volume
from .objects import build_glass, build_mirror, build_objects
from .rooms import Room, build_setting
from .worlds import build_panorama, build_sky, build_world

TRIANGLES = 2048, 16384                                             # the scene's budget
FILLED = 0.3, 1.2                                                   # of the budget by the objects; more is simplified
RESOLUTIONS = {128: 0.6, 192: 0.2, 256: 0.14, 384: 0.04, 512: 0.02}  # 2.3 times the pixels of 128 on average
OBJECTS = {1: 0.2, 2: 0.2, 3: 0.15, 4: 0.15, 6: 0.15, 9: 0.15}
MIRRORS = {0: 0.75, 1: 0.2, 2: 0.05}
GLASS = {0: 0.8, 1: 0.2}
MEDIA = {"none": 0.65, "smoke": 0.15, "fog": 0.2}
PANELS = {0: 0.6, 1: 0.25, 2: 0.15}
WORLDS = {  # with and without walls
    True: {"hdri": 0.25, "panorama": 0.15, "sky": 0.15, "constant": 0.1, "none": 0.35},
    False: {"hdri": 0.3, "panorama": 0.3, "sky": 0.3, "constant": 0.05, "none": 0.05},
}
SHARES = {"hdri": (0.2, 0.9), "panorama": (0.2, 0.9), "sky": (0.4, 1.0), "constant": (0.05, 0.6)}  # of all light
LIT_BY_WORLD = 0.4  # chance that a bright world is the only light


def build(rng: np.random.Generator, views: int) -> Setup | None:
    """A scene in the empty open file, or None when it has no good view."""
    budget = int(np.exp(rng.uniform(*np.log(TRIANGLES))))
    resolution, room, count = choose(rng, RESOLUTIONS), build_setting(rng), choose(rng, OBJECTS)
    for item in build_objects(rng, room, count, int(budget * rng.uniform(*FILLED)), fill=True):
        item.data.materials.append(build_material(rng, "full", "object"))
    for i in range(choose(rng, MIRRORS)):
        build_mirror(rng, room, f"mirror {i}")
    bpy.context.view_layer.update()
    cameras = build_wide_cameras(rng, room, views)
    if cameras is None:
        return None
    for i in range(choose(rng, GLASS)):
        build_glass(rng, cameras[i % views], f"glass {i}")
    medium = choose(rng, MEDIA)
    if medium != "none":
        {"smoke": build_volume, "fog": build_fog}[medium](rng, room, medium)
    add_light(rng, room)
    return Setup(cameras, budget, resolution)


def add_light(rng: np.random.Generator, room: Room) -> None:
    """World, panels and lamps share the irradiance that puts a half-grey facing surface at about half of white."""
    irradiance = 3.0 * np.exp(rng.normal(0.0, 0.35))
    world = "none" if room.kind == "closed_box" else choose(rng, WORLDS[bool(room.walls)])
    share = rng.uniform(*SHARES[world]) if world in SHARES else 0.0
    if share and not room.walls and rng.uniform() < LIT_BY_WORLD:
        share = 1.0
    if world == "sky":
        build_sky(rng, share * irradiance)
    elif world == "panorama":
        build_panorama(rng, share * irradiance / np.pi)
    else:
        build_world(rng, world, share * irradiance / np.pi)
    if share == 1.0:
        return
    panels, lamps = choose(rng, PANELS), int(rng.choice([1, 2, 3, 5, 8], p=[0.4, 0.25, 0.15, 0.12, 0.08]))
    irradiance_of_one = (1 - share) * irradiance / (panels + lamps)
    for i in range(panels):
        build_panel(rng, room, f"panel {i}", irradiance_of_one)
    build_lights(rng, room, lamps, lamps * irradiance_of_one)


def choose(rng: np.random.Generator, chances: dict):
    """One of the keys, by its chance."""
    return list(chances)[int(rng.choice(len(chances), p=list(chances.values())))]
