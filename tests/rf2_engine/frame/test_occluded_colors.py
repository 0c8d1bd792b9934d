# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours by the node Ambient Occlusion are those of Cycles, with and without its light."""
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, panel, room


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
def test_corners_have_another_colour(scene, tmp_path, light):
    dirty = material("Dirty")
    tree = dirty.node_tree
    occlusion, mix = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("AmbientOcclusion", "MixRGB"))
    mix.inputs["Color1"].default_value, mix.inputs["Color2"].default_value = (0.9, 0.1, 0.1, 1), (0.8, 0.8, 0.8, 1)
    tree.links.new(occlusion.outputs["AO"], mix.inputs["Fac"])
    tree.links.new(mix.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    room(scene, floor=dirty)
    panel(scene, None)
    lamp(scene)
    scene.renderformer_v2.light = light
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.08)
