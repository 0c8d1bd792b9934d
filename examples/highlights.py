# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes in which lamps are mirrored: by chrome, gold, a floor, crystals, a wall, plastic; and a spot's edge on glass.

    python examples/highlights.py OUT_DIR [NAME ...]      # OUT_DIR/chrome.blend, ...
    python -m tools.evaluate.direct OUT_DIR -o REPORT_DIR
"""
import sys
from math import cos, pi, radians, sin
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from bounced import BLUE, GREY, RED, WARM, WHITE, box, room, things  # noqa: E402
from effects import ball, cube, empty, lamp, plane  # noqa: E402
from room import material, put, save_scenes  # noqa: E402

SIZE = 128  # pixels
PASSES = [f"use_pass_{lobe}_{light}" for lobe in ("diffuse", "glossy", "transmission")
          for light in ("direct", "indirect", "color")]


def crystal(name, of, location, size):
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=1, radius=size, location=location, rotation=location)
    bpy.context.object.scale = (0.7, 0.7, 1.3)
    put(name, of)


def chrome():
    """Black chrome under a small lamp."""
    scene = empty(sky=0.02)
    black = material("Chrome", (0.2, 0.2, 0.22), 0.1, metallic=1.0)
    plane("Floor", black, (0, 0, 0), 20)
    bpy.ops.mesh.primitive_monkey_add(size=2, location=(0, 0, 1.1))
    put("Head", black).data.shade_smooth()
    bpy.context.object.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    lamp(scene, "POINT", (-1.5, -2, 3.5), energy=1000, shadow_soft_size=0.2)


def gold():
    """A gold ball and a lamp near walls."""
    scene = empty(eye=(0, -1.8, 1.4), target=(0, 0.6, 0.9))
    scene.camera.data.lens = 24
    room(plaster=WARM, walls={"left": RED})
    ball("Ball", material("Gold", (1.0, 0.75, 0.3), 0.25, metallic=1.0), (0.3, 0.6, 0.6), 0.6)
    bpy.context.object.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    lamp(scene, "POINT", (-1.2, 0.9, 2.2), energy=80, shadow_soft_size=0.08)


def twelve_lamps():
    """Twelve small lamps in a polished floor."""
    scene = empty(sky=0.02, eye=(0, -6, 1.6), target=(0, 0, 0.8))
    plane("Floor", material("Floor", (0.1, 0.08, 0.06), 0.12), (0, 0, 0), 30)
    for i in range(12):
        angle = 2 * pi * i / 12
        color = (1, 0.5 + 0.5 * cos(angle), 0.5 + 0.5 * sin(angle))
        lamp(scene, "POINT", (2 * cos(angle), 1 + 2 * sin(angle), 1), energy=25, shadow_soft_size=0.06, color=color)
    cube("Cube", material("White", WHITE), (0, 1, 0.5), 1)


def crystals():
    """Polished crystals of coloured metal under two lamps of some size."""
    scene = empty(sky=0.1, eye=(0, -5, 2.2))
    plane("Floor", material("Grey", GREY, 0.3), (0, 0, 0), 20)
    for i, color in enumerate((RED, BLUE, WARM, (0.1, 0.6, 0.3), WHITE)):
        crystal(f"Crystal {i}", material(f"Crystal {i}", color, 0.08, metallic=1.0),
                (1.0 * i - 2, 0.5 * (i % 2), 0.8), 0.6)
    lamp(scene, "AREA", (2, -2, 3.5), (35, 20, 0), energy=150, size=0.8)
    lamp(scene, "AREA", (-3, 0, 3), (0, -45, 0), energy=80, shape="DISK", size=0.6)


def spot():
    """A spot's edge on a wall, and a ball of glass."""
    scene = empty(eye=(0, -1.8, 1.4), target=(0, 0.6, 0.9))
    scene.camera.data.lens = 24
    room(plaster=GREY, floor=(0.2, 0.2, 0.2), floor_roughness=0.3)
    ball("Ball", material("Glass", WHITE, 0.0, transmission=1.0), (0.5, 0.4, 0.5), 0.5)
    bpy.context.object.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    lamp(scene, "SPOT", (-1.2, -0.6, 2.4), (52, 0, -30), energy=300, spot_size=radians(45), spot_blend=0.1,
         shadow_soft_size=0.05)


def glossy_wall():
    """An area lamp near a glossy wall."""
    scene = empty(eye=(0, -1.8, 1.4), target=(0.3, 0.6, 1.0))
    scene.camera.data.lens = 24
    room(plaster=WARM)
    box("Panel", material("Panel", (0.2, 0.22, 0.25), 0.2), (1.95, 0.3, 1.4), (0.1, 3, 2.6))
    things()
    lamp(scene, "AREA", (1.4, 1.2, 1.2), (0, -90, 0), energy=25, shape="RECTANGLE", size=1.2, size_y=0.3)


def plastic():
    """The sun on rough plastic."""
    scene = empty(sky=0.3)
    plane("Floor", material("Grey", GREY, 0.8), (0, 0, 0), 20)
    for i, roughness in enumerate((0.2, 0.4, 0.7)):
        ball(f"Ball {i}", material(f"Plastic {i}", (RED, BLUE, WARM)[i], roughness), (1.7 * i - 1.7, 0, 0.8), 0.8)
        bpy.context.object.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    lamp(scene, "SUN", rotation=(40, 25, 0), energy=4, angle=radians(0.5))


def panel():
    """A large panel above tiles, from mirror to matte."""
    scene = empty(sky=0.05, eye=(0, -5, 2.0), target=(0, 0, 0.3))
    for i, roughness in enumerate((0.0, 0.15, 0.3, 0.5, 0.8)):
        box(f"Tile {i}", material(f"Tile {i}", (0.5, 0.5, 0.5), roughness, metallic=1.0), (1.0 * i - 2, 0, -0.05),
            (0.98, 4, 0.1))
    lamp(scene, "AREA", (0, 2.5, 1.2), (-70, 0, 0), energy=60, shape="RECTANGLE", size=3, size_y=0.8)


SCENES = (chrome, gold, twelve_lamps, crystals, spot, glossy_wall, plastic, panel)


def set_size_and_passes():
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = SIZE
    for name in PASSES:
        setattr(bpy.context.view_layer, name, True)


if __name__ == "__main__":
    save_scenes(SCENES, set_size_and_passes)
