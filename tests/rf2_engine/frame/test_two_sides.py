# SPDX-License-Identifier: GPL-3.0-or-later
"""One material for both sides of a face (Geometry > Backfacing) lights a room as in Cycles."""
import pytest

from tests.rf2_engine.f12 import material
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


RED, BLUE = (0.9, 0.05, 0.05), (0.05, 0.1, 0.9)


@pytest.mark.parametrize("front, back", [
    ((RED, 0), (BLUE, 0)), ((BLUE, 0), (RED, 0)), ((RED, 5), (RED, 0)), ((RED, 0), (RED, 5))])
def test_each_side_reflects_and_shines_by_itself(scene, tmp_path, front, back):
    room(scene)
    panel(scene, by_side(front, back))
    lamp(scene, energy=60 if front[1] or back[1] else 150)
    ours, cycles = beside_cycles(scene, tmp_path)
    assert_alike(ours, cycles, rtol=0.1)
