# SPDX-License-Identifier: GPL-3.0-or-later
"""Light takes on the colour of what it passes: panes without refraction, and liquids."""
import bpy
import numpy as np
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, by_ray, lamp, panel, room


def pane(color):
    made = material("Pane")
    tree = made.node_tree
    tree.nodes.clear()
    shader, output = (tree.nodes.new(f"ShaderNode{name}") for name in ("BsdfTransparent", "OutputMaterial"))
    shader.inputs["Color"].default_value = (*color, 1)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return made


def liquid(color):
    made = material("Liquid")
    tree = made.node_tree
    inputs = tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (1, 1, 1, 1)
    inputs["Transmission Weight"].default_value, inputs["Roughness"].default_value = 1, 0
    inputs["IOR"].default_value = 1.33
    absorption = tree.nodes.new("ShaderNodeVolumeAbsorption")
    absorption.inputs["Color"].default_value = (*color, 1)
    absorption.inputs["Density"].default_value = 3
    tree.links.new(absorption.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    return made


BLUE, RED = (0.2, 0.5, 0.9), (0.9, 0.1, 0.05)  # a mean of more than half passes, or of less


@pytest.mark.parametrize("light, color", [("TRACED", BLUE), ("NETWORK", BLUE), ("NETWORK", RED)])
def test_a_coloured_pane_tints_a_room_as_in_cycles(scene, tmp_path, light, color):
    room(scene)
    panel(scene, pane(color), x=0.5, side=2.6)
    lamp(scene, energy=300)
    scene.renderformer_v2.light = light
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.1)


@pytest.mark.parametrize("color", [BLUE, RED])
def test_glass_that_shadow_rays_pass_straight_through_tints_a_room_as_in_cycles(scene, tmp_path, color):
    room(scene)
    glass, clear = ("BsdfGlass", {"IOR": 1.45}), ("BsdfTransparent", {"Color": (*color, 1)})
    panel(scene, by_ray("Glass", ("Is Shadow Ray", "Is Diffuse Ray"), glass, clear), x=0.5, side=2.6)
    lamp(scene, energy=300)
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.1)


def test_a_coloured_liquid_shows_and_sends_on_its_colour_as_in_cycles(scene, tmp_path):
    room(scene)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4, radius=0.9, location=(0.3, -0.5, 1.0))
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(liquid((0.9, 0.4, 0.1)))
    lamp(scene, energy=300)
    ours, cycles = beside_cycles(scene, tmp_path)
    ball = slice(12, 20), slice(22, 30)
    found, right = (picture[ball].mean((0, 1)) for picture in (ours, cycles))
    assert right[2] < 0.35 * right[0]
    np.testing.assert_allclose(found, right, rtol=0.15, atol=0.01)
    assert_alike(ours, cycles, rtol=0.15, atol=0.01)
