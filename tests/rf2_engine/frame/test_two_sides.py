# SPDX-License-Identifier: GPL-3.0-or-later
"""One material for both sides of a face (Geometry > Backfacing) lights a room as in Cycles."""
import pytest

from tests.rf2_engine.f12 import cube, material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, panel, room


def by_side(front, back):
    """A material whose Base Color and Emission Strength are those of the side."""
    made = material("Sides")
    tree = made.node_tree
    shader, geometry = tree.nodes["Principled BSDF"], tree.nodes.new("ShaderNodeNewGeometry")
    shader.inputs["Emission Color"].default_value = (1, 0.9, 0.7, 1)
    for name, kind, sockets, sides in (("Base Color", "RGBA", (6, 7, 2), (front[0], back[0])),
                                       ("Emission Strength", "FLOAT", (2, 3, 0), (front[1], back[1]))):
        mix = tree.nodes.new("ShaderNodeMix")
        mix.data_type = kind
        for socket, value in zip(sockets, sides):
            mix.inputs[socket].default_value = (*value, 1) if kind == "RGBA" else value
        tree.links.new(geometry.outputs["Backfacing"], mix.inputs[0])
        tree.links.new(mix.outputs[sockets[2]], shader.inputs[name])
    return made


RED, BLUE, BLACK = (0.9, 0.05, 0.05), (0.05, 0.1, 0.9), (0, 0, 0)  # what shines is no patch, and reflects nothing


@pytest.mark.parametrize("front, back", [
    ((RED, 0), (BLUE, 0)), ((BLUE, 0), (RED, 0)), ((BLACK, 5), (BLACK, 0)), ((BLACK, 0), (BLACK, 5))])
def test_each_side_reflects_and_shines_by_itself(scene, tmp_path, front, back):
    room(scene)
    panel(scene, by_side(front, back))
    if not front[1] and not back[1]:
        lamp(scene)  # what shines shades no lamp
    ours, cycles = beside_cycles(scene, tmp_path)
    assert_alike(ours, cycles, rtol=0.1)


@pytest.mark.parametrize("mixed", [False, True])
def test_translucent_things_light_the_other_side(scene, tmp_path, mixed):
    """Sheets and closed boxes; Cycles counts that as transmission, so traced light has followed it."""
    room(scene)
    paper = material("Paper")
    tree = paper.node_tree
    tree.nodes.clear()
    shader, output = (tree.nodes.new(f"ShaderNode{name}") for name in ("BsdfTranslucent", "OutputMaterial"))
    shader.inputs["Color"].default_value = (0.2, 0.7, 0.9, 1)
    if mixed:
        mix, matte = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfDiffuse")
        tree.links.new(shader.outputs[0], mix.inputs[1])
        tree.links.new(matte.outputs[0], mix.inputs[2])
        shader = mix
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    panel(scene, paper)
    cube(scene, "Box", (-1, 0, 0.75), paper).scale = (0.5,) * 3
    lamp(scene)
    ours, cycles = beside_cycles(scene, tmp_path)
    assert_alike(ours, cycles, rtol=0.14)
