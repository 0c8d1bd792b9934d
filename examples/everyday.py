# SPDX-License-Identifier: GPL-3.0-or-later
"""Four ordinary scenes: spheres under a panorama, a lit interior, many small objects, a furnished room.

    python examples/everyday.py OUT_DIR [NAME ...]      # OUT_DIR/spheres.blend, ...
    python -m tools.evaluate OUT_DIR -o REPORT_DIR --reference 512
"""
import random
import sys
from math import pi
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from bounced import BLUE, GREEN, RED, WARM, WHITE, WOOD, box, crockery, inside, room, table, things  # noqa: E402
from effects import ball, cube, empty, lamp  # noqa: E402
from room import material, save_scenes  # noqa: E402

SIZE = 512        # pixels
SKY = 256, 128    # pixels of the panorama


def panorama(scene):
    """A sky that is brighter towards the horizon, dark ground, a bright window of clouds and a small warm sun."""
    width, height = SKY
    v, u = np.mgrid[0:height, 0:width] / np.array([height - 1, width - 1]).reshape(2, 1, 1)
    up = np.clip(2 * v - 1, 0, 1)[..., None]
    sky = (1 - up) * (0.9, 0.95, 1.0) + up * (0.25, 0.45, 0.9)
    pixels = np.where(v[..., None] > 0.5, sky, (0.2, 0.16, 0.12))
    pixels += 3.0 * ((np.abs(u - 0.3) < 0.06) & (np.abs(v - 0.68) < 0.08))[..., None]
    pixels += np.array((120.0, 100.0, 70.0)) * (np.hypot(2 * (u - 0.7), v - 0.75) < 0.015)[..., None]
    image = bpy.data.images.new("Panorama", width, height, float_buffer=True)
    image.pixels.foreach_set(np.dstack([pixels, np.ones((height, width))]).astype(np.float32).ravel())
    image.pack()
    tree = scene.world.node_tree
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    tree.links.new(texture.outputs["Color"], tree.nodes["Background"].inputs["Color"])


def spheres():
    """Balls of matte, plastic, metal and glass on a plane, lit by a panorama alone."""
    scene = empty(sky=1.0, eye=(0, -6, 2.4), target=(0, 0, 0.5))
    panorama(scene)
    box("Ground", material("Ground", (0.45, 0.42, 0.38), 0.8), (0, 0, -0.05), (12, 12, 0.1))
    materials = ((RED, 0.9, 0, 0), (GREEN, 0.3, 0, 0), (WARM, 0.15, 1, 0), (WHITE, 0.05, 1, 0), (WHITE, 0.0, 0, 1),
             (BLUE, 0.5, 0, 0))
    for i, (color, *how) in enumerate(materials):
        ball(f"Ball {i}", material(f"Ball {i}", color, *how), (1.2 * (i % 3 - 1), 1.3 * (i // 3) - 0.6, 0.5), 0.5)


def interior():
    """A room with a window of light overhead: one area lamp, a table and things on the floor."""
    scene = inside()
    room(walls={"left": RED, "right": GREEN})
    table((0.9, 1.0))
    things()
    lamp(scene, "AREA", (0, 0.3, 2.75), energy=90, size=1.2)


def small_objects():
    """Three hundred cubes and balls of many colours on a table, under a lamp and a grey sky."""
    scene = empty(sky=0.3, eye=(0, -4.2, 3.0), target=(0, 0.1, 0))
    box("Table", material("Table", WOOD, 0.4), (0, 0, -0.05), (5, 5, 0.1))
    chance = random.Random(4)
    colors = [material(f"Colour {i}", [0.08 + 0.8 * chance.random() for _ in range(3)], chance.choice((0.2, 0.5, 0.9)))
              for i in range(12)]
    for i in range(300):
        size = 0.05 + 0.09 * chance.random()
        place = (4 * chance.random() - 2, 4 * chance.random() - 2, size)
        if i % 2:
            ball(f"Bead {i}", chance.choice(colors), place, size)
        else:
            cube(f"Cube {i}", chance.choice(colors), place, 2 * size)
            bpy.context.object.rotation_euler = (0, 0, pi * chance.random())
    lamp(scene, "AREA", (1.5, -1.0, 3.5), energy=250, size=0.8)


def furnished():
    """A room with a shelf of books, a table, a rug, a picture and two lamps."""
    scene = inside(eye=(0.4, -1.9, 1.6), target=(-0.1, 0.8, 0.9))
    room(plaster=WARM, floor=WOOD, floor_roughness=0.3)
    table((0.2, 0.9))
    crockery(0.2, 0.9)
    box("Rug", material("Rug", (0.45, 0.12, 0.14), 0.95), (0, 0.2, 0.01), (2.4, 1.8, 0.02))
    box("Picture", material("Picture", (0.15, 0.3, 0.45), 0.4), (0.6, 1.97, 1.7), (1.0, 0.04, 0.7))
    shelf, chance = material("Shelf", WHITE, 0.5), random.Random(7)
    covers = [material(f"Cover {i}", [0.05 + 0.6 * chance.random() for _ in range(3)], 0.6) for i in range(8)]
    for level in range(5):
        box(f"Board {level}", shelf, (-1.4, 1.8, 0.2 + 0.4 * level), (1.0, 0.35, 0.03))
        x = -1.88
        while level < 4 and x < -0.95:
            width, height = 0.03 + 0.05 * chance.random(), 0.22 + 0.12 * chance.random()
            box(f"Book {level} {x:.2f}", chance.choice(covers), (x + width / 2, 1.8, 0.215 + 0.4 * level + height / 2),
                (width, 0.25, height))
            x += width + 0.004
    lamp(scene, "AREA", (0, 0, 2.75), energy=60, size=0.6)
    lamp(scene, "POINT", (1.6, 1.5, 1.4), energy=25)


SCENES = (spheres, interior, small_objects, furnished)


def set_size():
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = SIZE


if __name__ == "__main__":
    save_scenes(SCENES, set_size)
