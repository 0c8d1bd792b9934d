# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that shine, as bright as in Cycles: light paths, visibility, view layers, light linking."""
import numpy as np
import pytest

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, irradiance, material
from tests.rf2_engine.convert.token_light import integrated

FACING_DOWN = ((-0.5, -0.5, 2), (-0.5, 0.5, 2), (0.5, 0.5, 2), (0.5, -0.5, 2))
POINT, UP = (0.2, 0, 0), (0, 0, 1)


@pytest.fixture
def emitter(add_mesh):
    """A square of radiance 5 two metres above the origin; returns (object, node tree, Emission node)."""
    empty_cycles_scene()
    made, tree, node = material("ShaderNodeEmission", "Glow", Strength=5.0)
    return add_mesh("Square", FACING_DOWN, [(0, 1, 2, 3)], [made]), tree, node


def assert_as_bright_as_in_cycles(converted, rtol=0.03):
    expected = irradiance(POINT, UP)
    np.testing.assert_allclose(integrated(converted(), POINT, UP), expected, rtol=rtol, atol=1e-4)
    return expected


@pytest.mark.parametrize("hidden_from_camera", [True, False])
def test_emitters_that_light_paths_hide_light_as_in_cycles(emitter, converted, hidden_from_camera):
    _, tree, glow = emitter
    path, mix, clear = (tree.nodes.new("ShaderNode" + kind) for kind in ("LightPath", "MixShader", "BsdfTransparent"))
    shaders = (glow, clear) if hidden_from_camera else (clear, glow)
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    for shader, entry in zip(shaders, (1, 2), strict=True):
        tree.links.new(shader.outputs[0], mix.inputs[entry])
    tree.links.new(mix.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    assert assert_as_bright_as_in_cycles(converted).any() == hidden_from_camera
