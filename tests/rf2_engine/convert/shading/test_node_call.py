# SPDX-License-Identifier: GPL-3.0-or-later
"""What a node's function can ask for."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.evaluate import Evaluator, Points
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.image import ImageCache
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.node_call import NodeCall

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, material


@pytest.fixture
def report():
    return Report()


@pytest.fixture
def call(report):
    """An Invert node of factor 0.25 whose colour comes from an RGB node."""
    empty_cycles_scene()
    _, tree, shader = material()
    node, color = tree.nodes.new("ShaderNodeInvert"), tree.nodes.new("ShaderNodeRGB")
    node.inputs[0].default_value, color.outputs[0].default_value = 0.25, (0.1, 0.2, 0.3, 1)
    tree.links.new(color.outputs[0], node.inputs["Color"])
    tree.links.new(node.outputs[0], shader.inputs["Base Color"])
    return NodeCall(Evaluator(Points(), ImageCache(report), report, "Rock"), node)


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
