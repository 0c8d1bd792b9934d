# SPDX-License-Identifier: GPL-3.0-or-later
"""What a node's function can ask for."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.evaluate import Evaluator
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.node_call import NodeCall
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.points import Points
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.surface import closure_at
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.volume import has_surface, volume_coefficients

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, material


@pytest.fixture
def report():
    return Report()


@pytest.fixture
def call(report):
    """An Invert node of factor 0.25 whose colour comes from an RGB node."""
    empty_cycles_scene()
    made, tree, shader = material()
    node, color = tree.nodes.new("ShaderNodeInvert"), tree.nodes.new("ShaderNodeRGB")
    node.inputs[0].default_value, color.outputs[0].default_value = 0.25, (0.1, 0.2, 0.3, 1)
    tree.links.new(color.outputs[0], node.inputs["Color"])
    tree.links.new(node.outputs[0], shader.inputs["Base Color"])
    copy = copied(made).node_tree
    node = next(node for node in copy.nodes if node.bl_idname == "ShaderNodeInvert")
    return NodeCall(Evaluator(Points(), copy.conventions, report, "Rock"), node)


def shader_of(made):
    """The closure that reaches the Surface of a material."""
    tree = copied(made).node_tree
    return closure_at(NodeCall(Evaluator(Points(), tree.conventions, Report(), "Rock"), tree.output), "Surface")


def test_inputs_by_name_number_and_link(call):
    np.testing.assert_allclose(call["Nothing of the kind", "Color"], (0.1, 0.2, 0.3), rtol=1e-6)
    np.testing.assert_allclose(call[0], [0.25])
    np.testing.assert_allclose(call.linked("Color"), (0.1, 0.2, 0.3), rtol=1e-6)
    assert call.linked(0) is None and call.source(0) is None
    assert call.source("Color").kind == "ShaderNodeRGB"
    assert len(call.values()) == 2


def test_input_that_this_blender_does_not_know_has_a_default_or_is_reported(call, report):
    np.testing.assert_array_equal(call.get("Thin Film", 0.5), [0.5])
    assert not report.entries
    np.testing.assert_array_equal(call["Thin Film", "Film"], [0])
    assert "Rock" in report.lines()[0] and "Thin Film" in report.lines()[0] and call.node.name in report.lines()[0]


@pytest.mark.parametrize("name, told", [("Invert Color.001", 'node "Invert Color.001": it is'),
                                        ("Negative", 'node "Negative" (Invert Color): it is')])
def test_a_remark_says_the_kind_of_a_node_once(call, report, name, told):
    call.node.name = name
    call.approximated("it is ignored")
    assert told in report.lines()[0]


def test_a_shader_that_feeds_itself_is_left_out_there():
    """A script can make it; Blender takes the link of the other shader for the invalid one."""
    empty_cycles_scene()
    made, tree, shader = material(Base_Color=(0.2, 0.4, 0.6, 1))
    mix, output = tree.nodes.new("ShaderNodeMixShader"), tree.get_output_node("CYCLES")
    for node, name in ((mix, 1), (shader, 2)):
        tree.links.new(node.outputs[0], mix.inputs[name])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    np.testing.assert_allclose(shader_of(made).color, (0, 0, 0))


def test_shared_shaders_are_evaluated_once():
    """Sixty Mix Shaders, each of the one before with itself: two to the sixtieth ways lead to the first."""
    empty_cycles_scene()
    made, tree, shader = material(Base_Color=(0.2, 0.4, 0.6, 1))
    output = tree.get_output_node("CYCLES")
    for _ in range(60):
        mix = tree.nodes.new("ShaderNodeMixShader")
        tree.links.new(shader.outputs[0], mix.inputs[1])
        tree.links.new(shader.outputs[0], mix.inputs[2])
        shader = mix
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    np.testing.assert_allclose(shader_of(made).color, (0.2, 0.4, 0.6), rtol=1e-4)


def test_an_output_of_another_kind_has_no_volume():
    """Cycles takes the output of a lamp in a material, too."""
    empty_cycles_scene()
    made, tree, shader = material()
    tree.nodes.remove(tree.get_output_node("CYCLES"))
    tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputLight").inputs["Surface"])
    assert has_surface(copied(made)) and volume_coefficients(copied(made), Report()) is None
