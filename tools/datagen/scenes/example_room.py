# SPDX-License-Identifier: GPL-3.0-or-later
"""The example profile: examples/room.py from elsewhere, under other lamps, with its own things or boxes and spheres.

One narrow family of scenes, from which a network that is small enough for a repository learns in an hour to render
(tools/verify_path).
"""
from __future__ import annotations

from math import pi

import bpy
import numpy as np

from examples import room

from .cameras import Setup

TRIANGLES, RESOLUTION = 640, 64
ITS_OWN = 0.3  # chance that the room holds what it holds in the example
THINGS = "Pedestal", "Suzanne", "Glass Ball", "Blue Box"
METAL = 0.2
CAMERA = ((-1.2, -7.3, 1.3), (1.2, -6.3, 2.8))  # around the example's, metres: least and most
TARGET = ((-0.3, -0.2, 1.6), (0.3, 0.2, 2.1))
LENS = 44, 52                                   # mm
LAMP = ((-1.1, -1.1, 3.4), (1.1, 0.6, 3.95))


def build(rng: np.random.Generator, views: int, triangles: int = TRIANGLES) -> Setup:
    """The room in place of the open file's scene."""
    room.furnish(bpy.context.scene)
    if rng.uniform() > ITS_OWN:
        for name in THINGS:
            bpy.data.objects.remove(bpy.data.objects[name])
        add_things(rng)
    light = bpy.data.objects["Ceiling Light"]
    light.location = rng.uniform(*LAMP)
    light.data.size, light.data.energy = rng.uniform(0.9, 1.6), rng.uniform(70, 130)
    light.data.color = room_color(rng, 0.5)
    bpy.data.objects.remove(bpy.context.scene.camera)
    cameras = []
    for _ in range(views):
        room.look("camera", rng.uniform(*CAMERA), rng.uniform(*TARGET), rng.uniform(*LENS))
        cameras.append(bpy.context.scene.camera)
    return Setup(cameras, triangles, RESOLUTION)


def add_things(rng: np.random.Generator) -> None:
    """Two or three boxes and spheres on the floor, none within another."""
    free = list(rng.permutation([(-1.1, -0.6), (1.1, -0.6), (-0.9, 0.9), (0.9, 0.9), (0.0, 0.2)]))
    for i in range(int(rng.integers(2, 4))):
        half, place = rng.uniform(0.3, 0.55), free[i] + rng.uniform(-0.15, 0.15, 2)
        if rng.uniform() < 0.5:
            height = half * rng.uniform(0.8, 2.5)
            bpy.ops.mesh.primitive_cube_add(size=1, location=(*place, height / 2), scale=(*2 * [half * 1.3], height),
                                            rotation=(0, 0, rng.uniform(0, pi / 2)))
            add = room.put
        else:
            bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8, radius=half, location=(*place, half))
            add = room.smooth
        color = room_color(rng, 0.9) * rng.uniform(0.3, 0.9)
        add(f"thing {i}", room.material(f"thing {i}", color, rng.uniform(0.3, 0.9), float(rng.uniform() < METAL)))


def room_color(rng: np.random.Generator, saturation: float) -> np.ndarray:
    """(3,) whose largest channel is 1, white or up to so saturated."""
    color = 1 - saturation * rng.uniform(0, 1, 3)
    return color / color.max()
