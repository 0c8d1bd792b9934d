# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways in which light enters a room without shining at what the camera sees; exposure.py sets how bright it is."""
from __future__ import annotations

import bmesh
import bpy
import numpy as np

from mathutils import Matrix, Vector

from .lights import add_emitter, random_light_color
from .materials import build_material
from .meshes import add_object, make_box
from .rooms import Room, add_plane
from .worlds import add_sun, build_sky, build_world

BACK = 1                          # of a closed box's surfaces: the wall at +Y
SLATTED, SUNNY, SUN_SHARE = 0.3, 0.4, (1.0, 8.0)
BULBS = 10, 40


def build_door(rng: np.random.Generator, room: Room) -> None:
    """A lamp in the next room, behind a door that is more or less open."""
    width, height = rng.uniform(0.25, 0.45), rng.uniform(0.65, 0.85)
    left = rng.uniform(0.1, 0.9 - width)
    wall = cut_opening(rng, room, (left, 0.0), (left + width, height))
    corner, right, up = find_back_wall(room)
    deep = np.array([0.0, rng.uniform(0.7, 1.6) * room.half, 0.0])
    far = corner + 0.001 * deep
    sides = [(far, -right, deep), (far + deep, -right, up), (far - right, deep, up), (far + deep, -deep, up),
             (far + up, deep, -right)]
    for i, side in enumerate(sides):
        add_plane(f"next room {i}", rng, *side).data.materials.append(wall)
    hinge = corner - right * left + 0.002 * deep
    low, high = np.array([-width * 2 * room.half, 0.0, 0.0]), np.array([0.0, 0.015, height * up[2]])
    leaf = add_part(make_box("leaf", low, high), build_material(rng, "full", "room"))
    leaf.matrix_world = Matrix.Translation(hinge) @ Matrix.Rotation(-rng.uniform(0.2, 1.4), 4, "Z")
    position = corner - right * rng.uniform(0.2, 0.8) + deep * rng.uniform(0.4, 0.8) + up * rng.uniform(0.8, 0.95)
    add_area_lamp(rng, position, (0, 0, -1), rng.uniform(0.1, 0.4))


def build_window(rng: np.random.Generator, room: Room) -> None:
    """Sky, and the sun by chance, through an opening in a wall, with the slats of a shutter by chance."""
    low = rng.uniform((0.1, 0.25), (0.45, 0.5))
    high = low + rng.uniform((0.2, 0.2), (0.45, 0.4))
    wall = cut_opening(rng, room, low, high)
    corner, right, up = find_back_wall(room)
    if rng.uniform() < SLATTED:
        count = int(rng.integers(4, 8))
        for i, share in enumerate(np.linspace(low[1], high[1], count)):
            middle = corner - right * (low[0] + high[0]) / 2 + up * share + np.array([0, 0.03, 0])
            size = np.array([(high[0] - low[0]) * 2 * room.half, 0.01, rng.uniform(0.4, 0.7) / count * up[2] * 0.5])
            add_part(make_box(f"slat {i}", middle - size / 2, middle + size / 2), wall)
    if rng.uniform() < 0.3:
        build_sky(rng, 3.0)
    else:
        build_world(rng, str(rng.choice(["hdri", "constant"])), 1.0)
    if rng.uniform() < SUNNY:
        toward = Vector((rng.uniform(-0.7, 0.7), 1.0, rng.uniform(0.3, 1.5))).normalized()
        add_sun(rng, toward, np.pi * rng.uniform(*SUN_SHARE))


def build_shades(rng: np.random.Generator, room: Room) -> None:
    """Bulbs under opaque shades, open above and below or below only."""
    for i in range(int(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))):
        position = random_position(rng, room, 0.5, 0.8, 0.6)
        cloth = build_material(rng, "full", "room", "dielectric")
        radius, height = rng.uniform(0.06, 0.16), rng.uniform(0.07, 0.18)
        add_cone(f"shade {i}", radius, radius * rng.uniform(0.35, 1.0), height, position, cloth,
                 is_closed=rng.uniform() < 0.4)
        add_bulb(rng, f"bulb {i}", position)


def build_uplights(rng: np.random.Generator, room: Room) -> None:
    """Lamps that shine at the ceiling only."""
    for i in range(int(rng.choice([1, 2], p=[0.7, 0.3]))):
        position = random_position(rng, room, 0.45, 0.75, 0.85)
        size = rng.uniform(0.05, 0.2)
        add_cone(f"bowl {i}", 0.3 * size, 0.75 * size, 0.4 * size, position - np.array([0, 0, 0.22 * size]),
                 build_material(rng, "full", "room", "dielectric"), is_closed=False)
        add_area_lamp(rng, position, (0, 0, 1), size)


def build_coves(rng: np.random.Generator, room: Room) -> None:
    """Strips of light behind ledges below the ceiling, along one wall to three."""
    material = build_material(rng, "full", "room", "dielectric")
    height, depth = room.floor + room.height * rng.uniform(0.78, 0.92), rng.uniform(0.05, 0.12)
    for i in range(int(rng.integers(1, 4))):
        turn = Matrix.Rotation(i * np.pi / 2, 4, "Z")
        half, lip = room.half * 0.995, rng.uniform(0.0, 0.05)
        low, high = np.array([-half, half - depth, height - 0.008]), np.array([half, half, height])
        lip_end = np.array([half, half - depth + 0.008, height + lip])
        add_part(make_box(f"ledge {i}", low, high), material).matrix_world = turn
        add_part(make_box(f"lip {i}", low, lip_end), material).matrix_world = turn
        strip = add_area_lamp(rng, turn @ Vector((0, half - depth / 2, height + 0.01)), (0, 0, 1), 1.8 * half)
        strip.data.shape, strip.data.size_y = "RECTANGLE", depth / 3
        strip.rotation_euler = (np.pi, 0, i * np.pi / 2)


def build_screen(rng: np.random.Generator, room: Room) -> None:
    """A lamp behind a board that stands in the room."""
    position = random_position(rng, room, 0.2, 0.6, 0.85)
    aside = np.cross([0, 0, 1], position / np.linalg.norm(position)) * rng.uniform(0.15, 0.35)
    foot = np.array([*(position[:2] * 0.85), room.floor]) - aside
    up = np.array([0, 0, (position[2] - room.floor) + rng.uniform(0.1, 0.3)])
    add_plane("board", rng, foot, 2 * aside, up).data.materials.append(build_material(rng, "full", "room"))
    add_bulb(rng, "bulb", position)


def build_bulbs(rng: np.random.Generator, room: Room) -> None:
    """Many small bulbs, most of them near the ceiling."""
    lowest = rng.choice([0.2, 0.8])
    for i in range(int(rng.integers(*BULBS))):
        add_bulb(rng, f"bulb {i}", random_position(rng, room, lowest, 0.95, 0.9), 0.3)


BUILDERS = {"door": build_door, "window": build_window, "shade": build_shades, "uplight": build_uplights,
            "cove": build_coves, "screen": build_screen, "bulbs": build_bulbs}


def find_back_wall(room: Room) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lower +X corner of the wall at +Y, its width towards +X and its height: corner - s right + t up."""
    return (np.array([room.half, room.half, room.floor]), np.array([2 * room.half, 0, 0]),
            np.array([0, 0, room.height]))


def cut_opening(rng: np.random.Generator, room: Room, low, high) -> bpy.types.Material:
    """Replace the back wall by the parts of it around an opening, both corners in shares of its sides.

    Returns its material.
    """
    wall = room.surfaces.pop(BACK)
    material = wall.data.materials[0]
    bpy.data.objects.remove(wall)
    corner, right, up = find_back_wall(room)
    parts = [(0, low[0], 0, 1), (high[0], 1, 0, 1), (low[0], high[0], 0, low[1]), (low[0], high[0], high[1], 1)]
    for i, (start, end, bottom, top) in enumerate(parts):
        if end - start > 1e-3 and top - bottom > 1e-3:
            part = add_plane(f"back {i}", rng, corner - start * right + bottom * up, (start - end) * right,
                             (top - bottom) * up)
            part.data.materials.append(material)
            room.surfaces.append(part)
    return material


def random_position(rng: np.random.Generator, room: Room, low: float, high: float, reach: float) -> np.ndarray:
    """A position between two heights, in shares of the room's, and so far from its middle at most."""
    return np.array([*rng.uniform(-reach, reach, 2) * room.half, room.floor + room.height * rng.uniform(low, high)])


def add_part(mesh: bpy.types.Mesh, material: bpy.types.Material) -> bpy.types.Object:
    mesh.materials.append(material)
    return add_object(mesh.name, mesh)


def add_cone(name: str, radius: float, top: float, height: float, position: np.ndarray, material: bpy.types.Material, *,
             is_closed: bool) -> None:
    """An open cone of 24 sides; is_closed: with a lid, a little below the top, where its bulb still has room."""
    mesh, bm = bpy.data.meshes.new(name), bmesh.new()
    bmesh.ops.create_cone(bm, segments=24, radius1=radius, radius2=top, depth=height, cap_ends=False)
    if is_closed:
        bmesh.ops.create_circle(bm, cap_ends=True, segments=24, radius=top,
                                matrix=Matrix.Translation((0, 0, 0.5 * height)))
    bm.to_mesh(mesh)
    bm.free()
    add_part(mesh, material).location = position


def add_bulb(rng: np.random.Generator, name: str, position: np.ndarray, size: float = 0.6) -> None:
    """A small glowing polyhedron of any colour."""
    added = add_emitter(rng, name, "mesh", Room("closed_box", 1, 0, 1, []), position, 1.0)
    added.scale, added.location = [size] * 3, position


def add_area_lamp(rng: np.random.Generator, position, toward, size: float) -> bpy.types.Object:
    lamp = bpy.data.lights.new("lamp", "AREA")
    lamp.shape, lamp.size, lamp.color = "SQUARE", size, random_light_color(rng)
    added = add_object("lamp", lamp)
    added.location = position
    added.rotation_euler = Vector(toward).to_track_quat("-Z", "Y").to_euler()
    return added
