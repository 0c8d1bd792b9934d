# SPDX-License-Identifier: GPL-3.0-or-later
"""Rooms lit by meshes that shine and reflect at once: a cube, two cubes, a panel, balls, a ring, bulbs before a wall.

    python examples/shining.py OUT_DIR [NAME ...]      # OUT_DIR/one_cube.blend, ...
    python -m tools.evaluate OUT_DIR -o REPORT_DIR
"""
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from bounced import BLUE, GREY, RED, WARM, box, room  # noqa: E402
from effects import ball, cube, empty  # noqa: E402
from layers import set_size  # noqa: E402
from room import material, put, save_scenes  # noqa: E402

LAMP = (1.0, 0.85, 0.6)


def shining(strength, color=LAMP):
    """Blender's default surface, with emission."""
    of = material("Shining", (0.8, 0.8, 0.8))
    shader = of.node_tree.nodes["Principled BSDF"].inputs
    shader["Emission Color"].default_value, shader["Emission Strength"].default_value = (*color, 1), strength
    return of


def furnished():
    """A room with a red and a blue wall, and a box."""
    scene = empty(eye=(0, -1.8, 1.2), target=(0, 0.6, 1.1))
    scene.camera.data.lens = 24
    room(plaster=WARM, floor=GREY, walls={"left": RED, "right": BLUE})
    box("Box", material("Box", GREY), (1.0, 0.9, 0.3), (0.6, 0.6, 0.6))


def one_cube():
    furnished()
    cube("Lamp", shining(4), (0, 0.3, 0.25), 0.5)


def sunk_cube():
    """Half of it is below the floor; another one is in the air."""
    furnished()
    cube("Lamp", shining(4), (0, 0.3, 0.0), 0.5)
    cube("Other", shining(6), (-0.4, 1.2, 1.2), 0.4)


def panel():
    furnished()
    box("Panel", shining(3, (1, 1, 1)), (0, 0.3, 2.3), (1.5, 1.0, 0.02))


def balls():
    furnished()
    ball("Ball", shining(5), (-0.6, 0.4, 1.2), 0.25)
    ball("Blue", shining(2, (0.3, 0.5, 1)), (0.4, 0.8, 1.0), 0.3)
    ball("Bright", shining(15), (0, 1.2, 1.8), 0.15)


def ring():
    furnished()
    bpy.ops.mesh.primitive_torus_add(major_radius=0.5, minor_radius=0.05, location=(0, 0.4, 2.1))
    put("Ring", shining(12)).data.shade_smooth()


def bulbs():
    """Three before a wall, close to it."""
    furnished()
    for x in (-0.6, 0.0, 0.6):
        ball("Bulb", shining(25), (x, 1.4, 1.6), 0.07)


SCENES = one_cube, sunk_cube, panel, balls, ring, bulbs


if __name__ == "__main__":
    save_scenes(SCENES, set_size)
