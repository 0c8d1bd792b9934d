# SPDX-License-Identifier: GPL-3.0-or-later
"""Three things of velvet, felt, car paint, lacquer, clay or brushed metal, under a large and a small lamp.

    python examples/layers.py OUT_DIR [NAME ...]      # OUT_DIR/velvet.blend, ...
    python -m tools.evaluate OUT_DIR -o REPORT_DIR
"""
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from bounced import BLUE, GREY  # noqa: E402
from effects import ball, empty, lamp, plane  # noqa: E402
from room import material, put, save_scenes  # noqa: E402

SIZE = 256  # pixels


def things(color, roughness=0.5, metallic=0.0, **inputs):
    """A ball, a ring and a head of a material with these inputs."""
    scene = empty(sky=0.3, eye=(0, -4.6, 2.2), target=(0, 0, 0.45))
    of = material("Layered", color, roughness, metallic)
    for name, value in inputs.items():
        of.node_tree.nodes["Principled BSDF"].inputs[name.replace("_", " ")].default_value = value
    plane("Floor", material("Floor", GREY, 0.8), (0, 0, 0), 8)
    plane("Wall", material("Wall", BLUE, 0.9), (0, 3, 4), 8, (90, 0, 0))
    ball("Ball", of, (-0.9, 0, 0.6), 0.6)
    bpy.context.object.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    bpy.ops.mesh.primitive_torus_add(major_radius=0.4, minor_radius=0.18, location=(0.2, -1.1, 0.18),
                                     major_segments=64, minor_segments=24)
    put("Ring", of).data.shade_smooth()
    bpy.ops.mesh.primitive_monkey_add(size=1.3, location=(0.9, 0.2, 0.6), rotation=(-0.6, 0, 0.3))
    put("Head", of).data.shade_smooth()
    bpy.context.object.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    lamp(scene, "AREA", (-2, -1.5, 3), (35, -35, 0), energy=120, size=1)
    lamp(scene, "POINT", (2, -2, 2), energy=60, shadow_soft_size=0.1)


def velvet():
    things((0.1, 0.01, 0.03), 1.0, Sheen_Weight=1.0)


def felt():
    things((0.05, 0.2, 0.08), 1.0, Sheen_Weight=1.0, Sheen_Roughness=0.8, Sheen_Tint=(0.3, 1.0, 0.4, 1))


def car_paint():
    things((0.5, 0.02, 0.02), 0.4, 1.0, Coat_Weight=1.0)


def lacquer():
    things((0.3, 0.12, 0.04), 0.6, Coat_Weight=1.0, Coat_Roughness=0.05)


def clay():
    things((0.6, 0.4, 0.3), 0.9, Diffuse_Roughness=1.0)


def brushed_metal():
    things((0.8, 0.8, 0.8), 0.3, 1.0, Anisotropic=0.8)


SCENES = velvet, felt, car_paint, lacquer, clay, brushed_metal


def set_size():
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = SIZE


if __name__ == "__main__":
    save_scenes(SCENES, set_size)
