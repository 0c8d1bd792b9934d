# SPDX-License-Identifier: GPL-3.0-or-later
"""Walls send the light of a lamp on as their glossy layer mirrors it, and that lights the room as in Cycles."""
import bpy
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, room


@pytest.mark.parametrize("metallic", [0, 1])
def test_a_polished_wall_lights_the_floor_before_it(scene, tmp_path, metallic):
    polished = material("Polished", (0.5 * metallic,) * 3)
    inputs = polished.node_tree.nodes["Principled BSDF"].inputs
    inputs["Roughness"].default_value, inputs["IOR"].default_value = 0.5, 2.0
    inputs["Specular IOR Level"].default_value, inputs["Metallic"].default_value = 1, metallic
    room(scene, right=polished, back=polished)
    bpy.data.objects.remove(scene.objects["ceiling"])
    lamp(scene, kind="SUN", turn=(0.2, -0.5, 0), energy=3)
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.1)


@pytest.mark.parametrize("distribution", ["GGX", "MULTI_GGX"])
@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
def test_rough_walls_of_metal_are_as_bright_as_their_facets_let_light_out(scene, tmp_path, distribution, light):
    rough = material("Rough", (0.8, 0.5, 0.3))
    node = rough.node_tree.nodes["Principled BSDF"]
    node.distribution = distribution
    node.inputs["Roughness"].default_value, node.inputs["Metallic"].default_value = 0.8, 1
    room(scene, right=rough, back=rough)
    lamp(scene)
    scene.renderformer_v2.light = light
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.1)
