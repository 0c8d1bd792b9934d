# SPDX-License-Identifier: GPL-3.0-or-later
"""Rooms in which most light has bounced before it is seen: doors ajar, shades, windows, uplights, haze, glossy floors.

    python examples/bounced.py OUT_DIR [NAME ...]      # OUT_DIR/door_ajar.blend, ...
    python -m tools.evaluate OUT_DIR -o REPORT_DIR --reference 512 --cycles 2 4 8 16
"""
import sys
from math import cos, pi, radians, sin
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from effects import ball, cube, empty, lamp  # noqa: E402
from room import material, put, save_scenes  # noqa: E402

WHITE, WARM, GREY = (0.8, 0.8, 0.8), (0.78, 0.72, 0.62), (0.5, 0.5, 0.5)
RED, GREEN, BLUE, WOOD = (0.7, 0.1, 0.07), (0.12, 0.42, 0.14), (0.1, 0.2, 0.6), (0.4, 0.22, 0.11)
ROOM = (4.0, 4.0, 2.8)  # metres
SIZE = 256              # pixels


def box(name, of, middle, size):
    """A box of these three sides."""
    bpy.ops.mesh.primitive_cube_add(size=1, location=middle)
    bpy.context.object.scale = size
    put(name, of)


def room(plaster=WHITE, floor=WOOD, floor_roughness=0.5, size=ROOM, open_to=(), walls=None):
    """Four walls, ceiling and floor around the origin; `open_to` names sides left out: left, right, front, back, top.

    walls: {side: colour} in place of plaster.
    """
    x, y, z = size
    of = {side: material(side.title(), (walls or {}).get(side, plaster), 0.9)
          for side in ("left", "right", "front", "back", "top")}
    box("Floor", material("Floor", floor, floor_roughness), (0, 0, -0.05), (x, y, 0.1))
    sides = {"left": ((-x / 2 - 0.05, 0, z / 2), (0.1, y, z)), "right": ((x / 2 + 0.05, 0, z / 2), (0.1, y, z)),
             "front": ((0, -y / 2 - 0.05, z / 2), (x, 0.1, z)), "back": ((0, y / 2 + 0.05, z / 2), (x, 0.1, z)),
             "top": ((0, 0, z + 0.05), (x + 0.2, y + 0.2, 0.1))}
    for side, (middle, dimensions) in sides.items():
        if side not in open_to:
            box(side.title(), of[side], middle, dimensions)


def pierced(name, of, y, low, high, size=ROOM):
    """A wall across the room at `y` with an opening from (x, z) `low` to `high`."""
    x, z = size[0], size[2]
    pieces = {"Left": (-x / 2, low[0], 0, z), "Right": (high[0], x / 2, 0, z),
              "Below": (low[0], high[0], 0, low[1]), "Above": (low[0], high[0], high[1], z)}
    for side, (left, right, below, above) in pieces.items():
        if right - left > 1e-3 and above - below > 1e-3:
            box(f"{name} {side}", of, ((left + right) / 2, y, (below + above) / 2), (right - left, 0.1, above - below))


def table(middle=(0, 0.5), height=0.75):
    wood = material("Table", WOOD, 0.35)
    box("Table Top", wood, (*middle, height), (1.4, 0.8, 0.05))
    for i, (x, y) in enumerate(((-1, -1), (1, -1), (-1, 1), (1, 1))):
        box(f"Leg {i}", wood, (middle[0] + 0.63 * x, middle[1] + 0.33 * y, height / 2), (0.06, 0.06, height))


def things():
    """A ball, a cube and a pillar on the floor."""
    ball("Ball", material("Blue", BLUE, 0.4), (-0.9, 0.6, 0.3), 0.3)
    cube("Cube", material("Red", RED, 0.7), (0.5, 0.9, 0.3), 0.6)
    bpy.ops.mesh.primitive_cylinder_add(vertices=32, radius=0.15, depth=1.2, location=(1.2, 0.0, 0.6))
    put("Pillar", material("Ivory", WARM, 0.5))


def crockery(x=0.0, y=0.5):
    """A ball and a cube on a table."""
    ball("Ball", material("Blue", BLUE, 0.4), (x - 0.35, y, 0.775 + 0.16), 0.16)
    cube("Cube", material("Red", RED, 0.7), (x + 0.3, y + 0.1, 0.775 + 0.15), 0.3)


def bulb(name, location, radius, radiance, color=(1, 0.85, 0.65)):
    shining = material(name, (0, 0, 0))
    shader = shining.node_tree.nodes["Principled BSDF"].inputs
    shader["Emission Color"].default_value, shader["Emission Strength"].default_value = (*color, 1), radiance
    bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=8, radius=radius, location=location)
    put(name, shining)


def tube(name, of, middle, radius, height, top_radius=None, vertices=32):
    """An open cone or cylinder."""
    bpy.ops.mesh.primitive_cone_add(vertices=vertices, radius1=radius, depth=height, location=middle,
                                    radius2=radius if top_radius is None else top_radius, end_fill_type="NOTHING")
    put(name, of).data.shade_smooth()


def inside(eye=(0, -1.9, 1.5), target=(0, 0.6, 1.0), lens=22, sky=0.0):
    """A scene seen from inside the room."""
    scene = empty(sky=sky, eye=eye, target=target)
    scene.camera.data.lens = lens
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    return scene


def door_ajar():
    """Light of the next room comes through a door that is open by a hand."""
    scene = inside()
    room(size=(4, 8, 2.8), walls={"left": WARM})
    pierced("Partition", material("Partition", WHITE, 0.9), 2.0, (-0.45, 0), (0.45, 2.1), size=(4, 8, 2.8))
    box("Door", material("Door", WOOD, 0.5), (-0.18, 2.2, 1.03), (0.04, 0.86, 2.06))
    bpy.context.object.rotation_euler = (0, 0, radians(62))
    things()
    lamp(scene, "AREA", (0.4, 3.2, 2.7), energy=1000, size=0.8)


def lampshade():
    """A bulb under an opaque shade: a pool on the table, the rest of the room by bounces."""
    inside()
    room(plaster=WARM)
    table()
    crockery()
    tube("Shade", material("Shade", (0.75, 0.7, 0.6), 0.8), (0, 0.5, 1.75), 0.35, 0.3, 0.18)
    bulb("Bulb", (0, 0.5, 1.75), 0.04, 1000)


def haze():
    """Sun through the slits of a shutter into a hazy room."""
    scene = inside(eye=(1.2, -1.8, 1.4), target=(-0.4, 0.6, 1.1))
    room(open_to=("left",))
    white = material("Shutter", WHITE, 0.9)
    for i in range(7):
        box(f"Slat {i}", white, (-2.0, 0, 0.15 + 0.42 * i), (0.06, 4.1, 0.3))
    things()
    box("Haze", material("Haze", WHITE), (0, 0, 1.4), (3.9, 3.9, 2.7))
    tree = bpy.data.materials["Haze"].node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    medium = tree.nodes.new("ShaderNodeVolumePrincipled")
    medium.inputs["Density"].default_value = 0.08
    tree.links.new(medium.outputs["Volume"], tree.nodes["Material Output"].inputs["Volume"])
    lamp(scene, "SUN", rotation=(0, -50, 12), energy=40, angle=radians(1))


def sixty_bulbs():
    """A garland of sixty small bulbs below the ceiling."""
    inside()
    room(plaster=GREY, walls={"left": RED, "right": GREEN})
    things()
    for i in range(60):
        angle = 2 * pi * i / 60
        bulb(f"Bulb {i}", (1.7 * cos(angle), 1.7 * sin(angle), 2.45 + 0.12 * sin(7 * angle)), 0.02, 100)


def uplight():
    """A lamp that shines at the ceiling only."""
    scene = inside()
    room(plaster=WARM)
    things()
    tube("Bowl", material("Bowl", (0.6, 0.55, 0.5), 0.5), (-1.4, 1.3, 1.75), 0.06, 0.2, 0.25)
    lamp(scene, "AREA", (-1.4, 1.3, 1.8), (180, 0, 0), energy=28, size=0.25, shape="DISK")


def window():
    """Sky through a window in a side wall, nothing else."""
    inside(sky=10.0, eye=(0, -1.9, 1.5), target=(-0.3, 0.6, 1.0))
    room(open_to=("back",), walls={"left": GREEN})
    pierced("Back", material("Back", WHITE, 0.9), 2.05, (0.5, 0.9), (1.5, 2.2))
    table((-0.6, 0.8))
    crockery(-0.6, 0.8)


def sunlit_window():
    """A patch of sun on the floor lights the room."""
    scene = inside(sky=0.4, eye=(-1.6, -1.8, 1.5), target=(0.4, 0.6, 0.9))
    room(open_to=("right",), plaster=WARM, floor=(0.55, 0.3, 0.15))
    for low, high in ((-2, -1), (0.2, 2)):
        box(f"Right {low}", material("Right", WARM, 0.9), (2.05, (low + high) / 2, 1.4), (0.1, high - low, 2.8))
    things()
    lamp(scene, "SUN", rotation=(0, 48, 20), energy=17, angle=radians(0.5))


def corridor():
    """A lamp around the corner of a corridor."""
    scene = inside(eye=(0, -3.6, 1.5), target=(0, 1.0, 1.2), lens=24)
    white = material("White", WHITE, 0.9)
    box("Floor", material("Floor", GREY, 0.4), (1.5, 0, -0.05), (5.2, 8.2, 0.1))
    box("Ceiling", white, (1.5, 0, 2.55), (5.2, 8.2, 0.1))
    box("Left", material("Left", RED, 0.9), (-1.05, 0, 1.25), (0.1, 8.2, 2.5))
    box("Right", material("Right", WARM, 0.9), (1.05, -1.1, 1.25), (0.1, 5.8, 2.5))
    box("Back", white, (1.5, 4.05, 1.25), (5.2, 0.1, 2.5))
    box("Front", white, (1.5, -4.05, 1.25), (5.2, 0.1, 2.5))
    box("End", white, (4.05, 2.9, 1.25), (0.1, 2.4, 2.5))
    box("Side", white, (2.55, 1.75, 1.25), (2.9, 0.1, 2.5))
    things()
    lamp(scene, "AREA", (3.2, 2.9, 2.4), energy=520, size=0.6)


def cove():
    """Strips hidden behind ledges along two walls."""
    scene = inside()
    room(plaster=WHITE, walls={"back": BLUE})
    for side in (-1, 1):
        box(f"Ledge {side}", material("Ledge", WHITE, 0.9), (1.85 * side, 0, 2.35), (0.3, 4, 0.04))
        box(f"Lip {side}", material("Lip", WHITE, 0.9), (1.71 * side, 0, 2.42), (0.02, 4, 0.12))
        lamp(scene, "AREA", (1.86 * side, 0, 2.42), (180, 0, 0), energy=30, shape="RECTANGLE", size=0.1, size_y=3.8)
    things()


def glossy_floor():
    """A window's sky in a polished floor."""
    inside(sky=6.0, eye=(0, -1.9, 1.1), target=(0, 0.8, 0.7))
    room(open_to=("back",), floor=(0.15, 0.12, 0.1), floor_roughness=0.15, walls={"left": RED, "right": BLUE})
    pierced("Back", material("Back", WHITE, 0.9), 2.05, (-0.8, 0.8), (0.8, 2.2))
    things()


def glass_torus():
    """A spot through a ring of glass, in a room that the rest of its light fills."""
    scene = inside(eye=(0, -1.9, 1.6), target=(0, 0.5, 0.5))
    room(plaster=WHITE)
    bpy.ops.mesh.primitive_torus_add(major_segments=48, minor_segments=20, location=(-0.2, 0.3, 0.45),
                                     major_radius=0.45, minor_radius=0.16, rotation=(radians(70), 0, radians(25)))
    put("Ring", material("Glass", (1, 1, 1), 0.0, transmission=1.0)).data.shade_smooth()
    cube("Cube", material("Red", RED, 0.7), (0.9, 0.9, 0.3), 0.6)
    lamp(scene, "SPOT", (1.4, -1.2, 2.6), (35, 0, 40), energy=1800, spot_size=radians(40), shadow_soft_size=0.08)


def bookshelf():
    """A desk lamp among shelves full of boxes."""
    scene = inside(eye=(0, -1.8, 1.4), target=(0, 1.2, 1.2))
    room(plaster=WARM)
    wood, colors = material("Shelf", WOOD, 0.5), (RED, GREEN, BLUE, WARM, GREY)
    for level in range(6):
        box(f"Shelf {level}", wood, (0, 1.8, 0.1 + 0.45 * level), (3.6, 0.36, 0.04))
        for i in range(18 if level < 5 else 0):
            if (7 * i + 5 * level) % 6:
                tall = 0.2 + 0.03 * ((3 * i + 2 * level) % 6)
                box(f"Book {level} {i}", material(f"Book {level} {i}", colors[(i * i + level) % 5], 0.6),
                    (-1.7 + 0.2 * i, 1.8, 0.12 + 0.45 * level + tall / 2), (0.12, 0.26, tall))
    table((0.4, 0.7))
    tube("Lamp Shade", material("Lamp Shade", GREEN, 0.4), (0.1, 0.7, 1.3), 0.16, 0.16, 0.06)
    lamp(scene, "POINT", (0.1, 0.7, 1.29), energy=140, shadow_soft_size=0.03)


def skylight():
    """A shaft in the ceiling lets the sky in."""
    inside(sky=60.0)
    room(plaster=WARM, open_to=("top",))
    white = material("Shaft", WHITE, 0.9)
    for x, y, wide, deep in ((-1.25, 0, 1.7, 4.2), (1.25, 0, 1.7, 4.2), (0, -1.25, 0.8, 1.7), (0, 1.25, 0.8, 1.7)):
        box(f"Ceiling {x} {y}", white, (x, y, 3.2), (wide, deep, 0.8))
    things()


def courtyard():
    """Between coloured walls, under a strip of sky, the sun on one wall alone."""
    scene = inside(sky=0.35, eye=(0, -4.6, 1.6), target=(0, 0, 1.6), lens=26)
    box("Ground", material("Ground", GREY, 0.8), (0, 0, -0.05), (5, 10, 0.1))
    box("Left", material("Left", (0.75, 0.35, 0.15), 0.9), (-2.05, 0, 3), (0.1, 10, 6))
    box("Right", material("Right", WHITE, 0.9), (2.05, 0, 3), (0.1, 10, 6))
    box("Back", material("Back", WARM, 0.9), (0, 5.05, 3), (5, 0.1, 6))
    things()
    lamp(scene, "SUN", rotation=(0, 35, 0), energy=4, angle=radians(0.5))


def arcade():
    """Behind a row of columns: sun outside, shade inside."""
    scene = inside(sky=0.6, eye=(1.2, -2.6, 1.5), target=(-0.2, 1.0, 1.2))
    stone = material("Stone", (0.6, 0.52, 0.4), 0.9)
    box("Ground", material("Ground", (0.5, 0.45, 0.35), 0.9), (-6, 0, -0.05), (16.2, 12, 0.1))
    box("Wall", stone, (2.05, 0, 1.5), (0.1, 6, 3))
    box("Roof", stone, (0.6, 0, 3.1), (3, 6.2, 0.2))
    box("Back", material("Back", RED, 0.9), (0.6, 3.05, 1.5), (3, 0.1, 3))
    for i in range(4):
        bpy.ops.mesh.primitive_cylinder_add(vertices=24, radius=0.2, depth=3, location=(-0.7, -2.4 + 1.6 * i, 1.5))
        put(f"Column {i}", stone)
    ball("Ball", material("White", WHITE, 0.3), (0.9, 1.0, 0.4), 0.4)
    lamp(scene, "SUN", rotation=(0, -30, 10), energy=5, angle=radians(0.5))


def metal_screen():
    """A lamp behind a screen, the room by way of a wall of brushed metal."""
    scene = inside()
    room(plaster=WHITE, walls={"left": WARM})
    box("Metal", material("Metal", (0.9, 0.75, 0.5), 0.35, metallic=1.0), (1.96, 0.4, 1.4), (0.04, 2.4, 2.4))
    box("Screen", material("Screen", BLUE, 0.8), (0.9, 0.9, 1.0), (0.05, 1.3, 2.0))
    ball("Ball", material("White", WHITE, 0.5), (-0.5, 0.4, 0.4), 0.4)
    lamp(scene, "AREA", (1.15, 1.0, 1.4), (0, -90, 0), energy=55, size=0.4)


def closet():
    """White on white in a small room, a bare bulb behind a beam: light that bounces ten times."""
    inside(eye=(0, -1.1, 1.3), target=(0, 0.4, 0.9))
    bright = (0.92, 0.92, 0.92)
    room(plaster=bright, floor=bright, floor_roughness=0.9, size=(2.4, 2.4, 2.2))
    white = material("White", bright, 0.9)
    box("Beam", white, (0, 0.2, 1.9), (2.4, 0.3, 0.3))
    ball("Ball", white, (-0.4, 0.5, 0.3), 0.3)
    cube("Cube", white, (0.45, 0.6, 0.25), 0.5)
    bulb("Bulb", (0, 0.7, 2.0), 0.05, 80)


def stairs():
    """A cellar's stairs, lit from above through a hatch."""
    scene = inside(eye=(-1.5, -1.7, 1.4), target=(0.5, 0.9, 1.0))
    room(plaster=(0.45, 0.42, 0.4), floor=(0.3, 0.28, 0.26), open_to=("top",))
    stone = material("Stone", (0.45, 0.42, 0.4), 0.9)
    box("Ceiling", stone, (-0.6, 0, 2.85), (2.9, 4.2, 0.1))
    box("Ceiling Front", stone, (1.4, -1.2, 2.85), (1.2, 1.8, 0.1))
    for i in range(9):
        box(f"Step {i}", material("Step", WOOD, 0.7), (1.4, -0.3 + 0.25 * i, 0.15 + 0.3 * i), (1.0, 0.26, 0.04))
    box("Barrel", material("Barrel", WOOD, 0.6), (-0.6, 1.2, 0.4), (0.6, 0.6, 0.8))
    lamp(scene, "AREA", (1.4, 1.0, 4.4), energy=600, size=1.2)


def perforated():
    """A lantern whose shade is full of holes."""
    inside()
    room(plaster=WARM)
    dark = material("Lantern", (0.2, 0.12, 0.06), 0.6)
    for ring in range(6):
        for i in range(16):
            if (i + ring) % 2:
                continue
            angle = 2 * pi * (i + 0.5) / 16
            box(f"Plate {ring} {i}", dark, (0.25 * cos(angle), 0.5 + 0.25 * sin(angle), 1.3 + 0.1 * ring),
                (0.01, 0.1, 0.1))
            bpy.context.object.rotation_euler = (0, 0, angle)
    bulb("Bulb", (0, 0.5, 1.55), 0.04, 900)
    things()


ROOMS = (door_ajar, lampshade, haze, sixty_bulbs, uplight, window, sunlit_window, corridor, cove, glossy_floor,
         glass_torus, bookshelf, skylight, courtyard, arcade, metal_screen, closet, stairs, perforated)


if __name__ == "__main__":
    save_scenes(ROOMS)
