# SPDX-License-Identifier: GPL-3.0-or-later
"""The indirect profile: closed rooms in which most light has bounced before it is seen, with all chances in one place.

Light comes through doors and windows, from under shades, off ceilings, from behind ledges and screens, or from many
small bulbs (indirect_light.py); pale plaster and polished floors; haze; up to nine objects; cameras inside. The
brightness is set by a quick picture, because it cannot be guessed (exposure.py).
"""
from __future__ import annotations

import bpy
import numpy as np

from .cameras import Setup, build_interior_cameras
from .exposure import expose
from .indirect_light import BUILDERS
from .materials import build_material, set_inputs
from .media import build_fog
from .objects import build_mirror, build_objects
from .rooms import build_room
from .wide import choose

CHANCES = {"door": 0.2, "window": 0.25, "shade": 0.15, "uplight": 0.15, "cove": 0.1, "screen": 0.05, "bulbs": 0.1}
OBJECTS = {1: 0.2, 2: 0.25, 3: 0.2, 4: 0.15, 6: 0.1, 9: 0.1}
PALE, POLISHED, HAZY, MIRRORED = 0.7, 0.35, 0.15, 0.15
TRIANGLES = 4096


def build(rng: np.random.Generator, views: int) -> Setup | None:
    """A scene in the empty open file, or None when it has no good view or hardly any light."""
    room = build_room(rng, {"closed_box": 1.0})
    for surface in room.surfaces:
        is_pale = rng.uniform() < PALE
        surface.data.materials.append(plaster_material(rng) if is_pale else build_material(rng, "full", "room"))
    if rng.uniform() < POLISHED:
        room.surfaces[0].data.materials[0] = polished_material(rng)
    for item in build_objects(rng, room, choose(rng, OBJECTS), 2000):
        item.data.materials.append(build_material(rng, "full", "object"))
    if rng.uniform() < MIRRORED:
        build_mirror(rng, room, "mirror")
    BUILDERS[choose(rng, CHANCES)](rng, room)
    bpy.context.view_layer.update()
    cameras = build_interior_cameras(rng, room, views)
    if cameras is None:
        return None
    if rng.uniform() < HAZY:
        build_fog(rng, room, "haze")
    return Setup(cameras, TRIANGLES) if expose(rng, cameras[0]) else None


def plaster_material(rng: np.random.Generator) -> bpy.types.Material:
    """Pale and matte."""
    material = build_material(rng, "full", "room", "dielectric")
    pale = np.clip(rng.uniform(0.4, 0.88) * (1 + rng.normal(0, 0.08, 3)), 0.1, 0.92)
    set_inputs(material, {"Base Color": pale, "Roughness": rng.uniform(0.6, 1.0)})
    return material


def polished_material(rng: np.random.Generator) -> bpy.types.Material:
    """A floor of tiles, stone or varnished wood."""
    material = build_material(rng, "full", "room", str(rng.choice(["dielectric", "textured_dielectric"])))
    set_inputs(material, {"Roughness": rng.uniform(0.03, 0.35)})
    return material
