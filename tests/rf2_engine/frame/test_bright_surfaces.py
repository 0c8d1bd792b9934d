# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that reflect more light than arrives light a room as in Cycles."""
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, room


def principled(metallic):
    made = material("Bright", (1.8, 1.3, 1))
    made.node_tree.nodes["Principled BSDF"].inputs["Metallic"].default_value = metallic
    return made


def added():
    made = material("Added")
    tree = made.node_tree
    tree.nodes.clear()
    total, output = (tree.nodes.new(f"ShaderNode{name}") for name in ("AddShader", "OutputMaterial"))
    for entry in total.inputs:
        diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
        diffuse.inputs["Color"].default_value = (0.9, 0.6, 0.4, 1)
        tree.links.new(diffuse.outputs[0], entry)
    tree.links.new(total.outputs[0], output.inputs["Surface"])
    return made


@pytest.mark.parametrize("make", [lambda: principled(0), lambda: principled(1), added])
@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
def test_what_reflects_more_than_arrives_lights_a_room_as_in_cycles(scene, tmp_path, make, light):
    room(scene, right=make())
    lamp(scene)
    scene.renderformer_v2.light = light
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.08)
