# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes, one for each thing that light does: shadow, mirror, glass, colour bleeding, fog, ground, sky, panel.

    python examples/effects.py OUT_DIR          # OUT_DIR/shadow.blend, ...
    python -m tools.evaluate OUT_DIR -o REPORT_DIR
"""
import sys
from math import radians
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from room import look, material, put, save_scenes  # noqa: E402

SIZE = 192  # pixels
WHITE, RED = (0.8, 0.8, 0.8), (0.8, 0.1, 0.08)


def empty(sky=0.0, eye=(0, -6, 2.2), target=(0, 0, 0.8)):
    """A scene with a camera and a grey sky."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (sky, sky, sky, 1)
    look("Camera", eye, target, clip_end=1e5)
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.cycles.samples = 256
    return scene


def lamp(scene, kind, location=(0, 0, 3), rotation=(0, 0, 0), **settings):
    made = bpy.data.objects.new("Light", bpy.data.lights.new("Light", kind))
    made.location, made.rotation_euler = location, [radians(angle) for angle in rotation]
    for name, value in settings.items():
        setattr(made.data, name, value)
    scene.collection.objects.link(made)


def plane(name, of, location, size=8.0, rotation=(0, 0, 0)):
    bpy.ops.mesh.primitive_plane_add(size=size, location=location, rotation=[radians(angle) for angle in rotation])
    put(name, of)


def cube(name, of, location, size=1.0):
    bpy.ops.mesh.primitive_cube_add(size=size, location=location)
    put(name, of)


def ball(name, of, location, radius=0.8):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=radius, location=location)
    put(name, of).data.shade_smooth()


def shadow():
    """A cube's shadow in the sun falls to the right of it."""
    scene = empty(sky=0.15, eye=(0, -6, 4))
    plane("Floor", material("White", WHITE), (0, 0, 0), 20)
    cube("Cube", material("Red", RED), (-0.6, 0, 0.7), 1.4)
    lamp(scene, "SUN", rotation=(0, -55, 0), energy=3, angle=radians(2))


def mirror():
    """A wall of silver shows the back of a red ball."""
    scene = empty(sky=0.3)
    plane("Floor", material("White", WHITE), (0, 0, 0), 20)
    plane("Mirror", material("Silver", (0.95, 0.95, 0.95), 0.02, metallic=1.0), (0, 2.5, 2), 5, (90, 0, 0))
    ball("Ball", material("Red", RED), (0, 0.8, 0.8))
    lamp(scene, "AREA", (2, -3, 4), (40, 0, 30), energy=250, size=1.5)


def glass():
    """A pane of glass before a red cube, which is seen through it."""
    scene = empty(sky=0.3)
    plane("Floor", material("White", WHITE), (0, 0, 0), 20)
    cube("Cube", material("Red", RED), (0, 1.5, 0.9), 1.8)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, -0.5, 1))
    pane = put("Pane", material("Glass", (1, 1, 1), 0.0, transmission=1.0))
    pane.scale = (2.4, 0.05, 2)
    lamp(scene, "AREA", (2, -3, 4), (40, 0, 30), energy=250, size=1.5)


def bleeding():
    """A white floor turns red beside a wall in the sun."""
    scene = empty(eye=(-3, -5, 4), target=(0.5, 0, 0.3))
    plane("Floor", material("White", WHITE), (0, 0, 0), 6)
    plane("Wall", material("Red", RED, 0.9), (2, 0, 2), 4, (0, -90, 0))
    lamp(scene, "SUN", rotation=(0, -88, 0), energy=6, angle=radians(1))


def fog():
    """A cube of thin fog before a dark wall, lit from the side."""
    scene = empty()
    plane("Floor", material("Grey", (0.3, 0.3, 0.3)), (0, 0, 0), 20)
    plane("Wall", material("Dark", (0.02, 0.02, 0.02)), (0, 4, 0), 30, (90, 0, 0))
    cube("Fog", material("Fog", WHITE), (0, 0, 1), 1.8)
    tree = bpy.data.materials["Fog"].node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    medium = tree.nodes.new("ShaderNodeVolumePrincipled")
    medium.inputs["Density"].default_value = 1.0
    tree.links.new(medium.outputs["Volume"], tree.nodes["Material Output"].inputs["Volume"])
    lamp(scene, "AREA", (3, -1, 2.5), (0, 60, 0), energy=400, size=1)


def ground():
    """A cube on a ground to the horizon, ten kilometres wide."""
    scene = empty(sky=0.4, eye=(0, -6, 2))
    plane("Ground", material("Sand", (0.5, 0.4, 0.3)), (0, 0, 0), 10_000)
    cube("Cube", material("White", WHITE), (0, 0, 0.8), 1.6)
    lamp(scene, "SUN", rotation=(50, 0, 40), energy=3, angle=radians(2))


def sky():
    """A ball under a sky that is brighter above, nothing else."""
    scene = empty(eye=(0, -5, 0.3), target=(0, 0, 0))
    ball("Ball", material("White", WHITE, 0.9), (0, 0, 0), 1.2)
    tree = scene.world.node_tree
    ramp, split, place = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("MapRange", "SeparateXYZ", "TexCoord"))
    ramp.inputs["From Min"].default_value, ramp.inputs["To Min"].default_value = -1, 0.05
    for source, target in ((place.outputs["Generated"], split.inputs[0]), (split.outputs["Z"], ramp.inputs["Value"]),
                           (ramp.outputs["Result"], tree.nodes["Background"].inputs["Color"])):
        tree.links.new(source, target)


def panel():
    """A closed flat panel of light, two metres wide and five centimetres thick, under a ceiling."""
    empty(eye=(0, -5.5, 1.2), target=(0, 0, 1.3))
    white = material("White", WHITE)
    plane("Floor", white, (0, 0, 0), 5)
    plane("Ceiling", white, (0, 0, 3), 5, (180, 0, 0))
    plane("Wall", white, (0, 2.5, 1.5), 5, (90, 0, 0))
    cube("Cube", material("Red", RED), (-0.8, 0.5, 0.5), 1)
    shining = material("Shining", WHITE)
    shader = shining.node_tree.nodes["Principled BSDF"].inputs
    shader["Emission Color"].default_value, shader["Emission Strength"].default_value = (1, 1, 1, 1), 6
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, 2.8))
    put("Panel", shining).scale = (2, 2, 0.05)


EFFECTS = (shadow, mirror, glass, bleeding, fog, ground, sky, panel)

if __name__ == "__main__":
    save_scenes(EFFECTS)
