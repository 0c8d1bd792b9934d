# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes room.blend: coloured walls, Suzanne in copper, a glass ball, a glossy pillar, an area light.

    python examples/room.py OUT.blend
"""
import os
import sys
from math import radians
from pathlib import Path

import bpy

from mathutils import Vector


def material(name, color, roughness=0.6, metallic=0.0, transmission=0.0):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"].inputs
    shader["Base Color"].default_value = (*color, 1)
    shader["Roughness"].default_value = roughness
    shader["Metallic"].default_value = metallic
    shader["Transmission Weight"].default_value = transmission
    return made


def put(name, of):
    """Name the object that an operator has just added and give it a material."""
    added = bpy.context.object
    added.name = name
    added.data.materials.append(of)
    return added


def wall(name, of, location, rotation):
    bpy.ops.mesh.primitive_plane_add(size=4, location=location, rotation=rotation)
    put(name, of)


def smooth(name, of):
    added = put(name, of)
    added.data.shade_smooth()
    return added


def look(name, place, target, lens=50, clip_end=1000):
    """The camera of the scene, a new one."""
    data = bpy.data.cameras.new(name)
    data.lens, data.clip_end = lens, clip_end
    camera = bpy.data.objects.new(name, data)
    camera.location = place
    camera.rotation_euler = (Vector(target) - camera.location).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def build():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    furnish(bpy.context.scene)


def furnish(scene):
    """Put everything into an empty scene."""
    plaster = material("Plaster", (0.78, 0.75, 0.70), 0.9)
    wall("Floor", material("Floor", (0.55, 0.50, 0.44), 0.35), (0, 0, 0), (0, 0, 0))
    wall("Ceiling", plaster, (0, 0, 4), (radians(180), 0, 0))
    wall("Back Wall", plaster, (0, 2, 2), (radians(90), 0, 0))
    wall("Left Wall", material("Brick Red", (0.63, 0.09, 0.06), 0.9), (-2, 0, 2), (0, radians(90), 0))
    wall("Right Wall", material("Moss Green", (0.13, 0.38, 0.10), 0.9), (2, 0, 2), (0, radians(-90), 0))

    bpy.ops.mesh.primitive_cylinder_add(vertices=48, radius=0.62, depth=0.9, location=(-0.65, 0.55, 0.45))
    put("Pedestal", material("Ivory", (0.80, 0.77, 0.68), 0.5))
    bpy.ops.mesh.primitive_monkey_add(size=1.15, location=(-0.65, 0.5, 1.42), rotation=(radians(-8), 0, radians(18)))
    smooth("Suzanne", material("Copper", (0.93, 0.52, 0.36), 0.25, metallic=1.0)).modifiers.new("Smooth", "SUBSURF")
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=0.5, location=(0.95, -0.55, 0.5))
    smooth("Glass Ball", material("Glass", (1, 1, 1), 0.0, transmission=1.0))
    bpy.ops.mesh.primitive_cube_add(size=0.7, location=(0.95, 0.95, 0.35), rotation=(0, 0, radians(28)))
    put("Blue Box", material("Blue Lacquer", (0.05, 0.16, 0.55), 0.2))

    lamp = bpy.data.lights.new("Ceiling Light", "AREA")
    lamp.shape, lamp.size, lamp.energy, lamp.color = "SQUARE", 1.3, 110, (1.0, 0.92, 0.80)
    light = bpy.data.objects.new("Ceiling Light", lamp)
    light.location = (0, 0, 3.95)
    scene.collection.objects.link(light)

    look("Camera", (0, -6.9, 2.05), (0, 0, 1.85), 48)
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.05, 0.06, 0.08, 1)
    scene.render.resolution_x = scene.render.resolution_y = 512
    scene.cycles.samples = 128


def choose_engine():
    """Register the add-on from this source tree, for a file that opens with its engine chosen."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from tools import extension
    if not hasattr(bpy.types.Scene, "renderformer_v2"):
        extension.load().register()
    bpy.context.scene.render.engine = "RENDERFORMER_V2"


def save(file):
    """The scene, with our engine chosen, in a .blend file, whose folder is made."""
    choose_engine()
    file.parent.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(file.absolute()), compress=True)


def save_scenes(builders, finish=lambda: None):
    """Write OUT_DIR/NAME.blend of the scenes that the command line names after OUT_DIR, or of all, and end the process.

    finish: sets what all of them have in common.
    """
    folder, names = Path(sys.argv[1]), sys.argv[2:]
    for builder in builders:
        if not names or builder.__name__ in names:
            builder()
            finish()
            save(folder / f"{builder.__name__}.blend")
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    build()
    save(Path(sys.argv[1]))
    sys.stdout.flush()
    os._exit(0)
