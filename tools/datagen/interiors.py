# SPDX-License-Identifier: GPL-3.0-or-later
"""The indirect profile: closed rooms in which most light has bounced before it is seen, with all chances in one place.

Light comes through doors and windows, from under shades, off ceilings, from behind ledges and screens, or from many
small bulbs (indirect.py); pale plaster and polished floors; haze; up to nine objects; cameras inside. The brightness is
set by a quick picture, because it cannot be guessed (exposure.py).
"""
from __future__ import annotations

import bpy
import numpy as np

from .cameras import LEAST_COVERED, TRIES, Setup, add_camera, inside_pose, sees_enough
from .exposure import expose
from .indirect import WAYS
from .materials import build_material, set_value
from .mirrors import build_mirror
from .objects import build_objects
from .templates import Room, build_room
from .volumes import build_fog
from .wide import chosen

CHANCES = {"door": 0.2, "window": 0.25, "shade": 0.15, "uplight": 0.15, "cove": 0.1, "screen": 0.05, "bulbs": 0.1}
OBJECTS = {1: 0.2, 2: 0.25, 3: 0.2, 4: 0.15, 6: 0.1, 9: 0.1}
PALE, POLISHED, HAZY, MIRRORED = 0.7, 0.35, 0.15, 0.15
FIELD_OF_VIEW = np.radians((40.0, 85.0))
TRIANGLES = 4096


def build(rng: np.random.Generator, views: int) -> Setup | None:
    """A scene in the empty open file, or None when it has no good view or hardly any light."""
    room = build_room(rng, {"closed_box": 1.0})
    for surface in room.surfaces:
        plain = rng.uniform() < PALE
        surface.data.materials.append(plaster(rng) if plain else build_material(rng, "full", "room"))
    if rng.uniform() < POLISHED:
        room.surfaces[0].data.materials[0] = polish(rng)
    for thing in build_objects(rng, room, chosen(rng, OBJECTS), 2000):
        thing.data.materials.append(build_material(rng, "full", "object"))
    if rng.uniform() < MIRRORED:
        build_mirror(rng, room, "mirror")
    WAYS[chosen(rng, CHANCES)](rng, room)
    bpy.context.view_layer.update()
    cameras = build_insides(rng, room, views)
    if cameras is None:
        return None
    if rng.uniform() < HAZY:
        build_fog(rng, room, "haze")
    return Setup(cameras, TRIANGLES) if expose(rng, cameras[0]) else None


def build_insides(rng: np.random.Generator, room: Room, count: int) -> list[bpy.types.Object] | None:
    """`count` cameras in the room with lenses as rooms need them, or None when it has no good view."""
    cameras = []
    for i in range(count):
        for _ in range(TRIES):
            pose, fov = inside_pose(rng, room), rng.uniform(*FIELD_OF_VIEW)
            if sees_enough(pose, fov, LEAST_COVERED):
                break
        else:
            return None
        cameras.append(add_camera(f"camera {i}", pose, fov))
    return cameras


def plaster(rng: np.random.Generator) -> bpy.types.Material:
    """Pale and matte."""
    material = build_material(rng, "full", "room", "dielectric")
    shader = material.node_tree.nodes["Principled BSDF"]
    pale = np.clip(rng.uniform(0.4, 0.88) * (1 + rng.normal(0, 0.08, 3)), 0.1, 0.92)
    set_value(shader, "Base Color", (*map(float, pale), 1.0))
    set_value(shader, "Roughness", rng.uniform(0.6, 1.0))
    return material


def polish(rng: np.random.Generator) -> bpy.types.Material:
    """A floor of tiles, stone or varnished wood."""
    material = build_material(rng, "full", "room", str(rng.choice(["dielectric", "textured_dielectric"])))
    set_value(material.node_tree.nodes["Principled BSDF"], "Roughness", rng.uniform(0.03, 0.35))
    return material
