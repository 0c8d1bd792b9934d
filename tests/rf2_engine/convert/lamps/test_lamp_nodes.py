# SPDX-License-Identifier: GPL-3.0-or-later
"""Node trees of lamps against Cycles: strength, falloff, IES profiles, textures over directions and surfaces."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import LampInstance
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.lamps.lamp_triangles import convert_light
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.lamps.placed_lamp import BoundingSphere
from mathutils import Matrix

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, irradiance, lamp
from tests.rf2_engine.convert.token_light import integrated

POSE = Matrix.Translation((0.3, -0.2, 2.5)) @ Matrix.Rotation(0.4, 4, "X") @ Matrix.Rotation(0.3, 4, "Y")
POINTS = ((0, 0, 0), (-1, -0.3, 0.2), (1.5, 0.5, 0))
UP = (0, 0, 1)
SHAPES = {"POINT": dict(shadow_soft_size=0.1), "SPOT": dict(shadow_soft_size=0.1, spot_size=2.5),
          "AREA": dict(size=1.0), "SUN": dict(angle=0.1)}
IES = """IESNA:LM-63-1995
TILT=NONE
1 1000 2.0 {rows} {columns} 1 2 0 0 0 1.0 1.0 100
{polar}
{around}
{candela}
"""


def shining(kind, **settings):
    """(lamp object, its node tree, Emission node)."""
    empty_cycles_scene()
    obj = lamp(kind, POSE, energy=20, **SHAPES[kind], **settings)
    obj.data.use_nodes = True
    return obj, obj.data.node_tree, obj.data.node_tree.nodes["Emission"]


def converted(obj, report=None):
    scene = convert_light(LampInstance(obj.name, np.array(obj.matrix_world, np.float64), copied(obj.data)),
                          BoundingSphere(np.zeros(3), 1.0), report or Report())
    scene.validate()
    return scene


def assert_as_in_cycles(obj, rtol, points=POINTS, report=None):
    scene = converted(obj, report)
    expected = np.array([irradiance(point, UP) for point in points])
    assert expected.any(axis=1).all()
    found = [integrated(scene, point, UP) for point in points]
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=0.1 * rtol * expected.max())


def test_node_tree_of_a_lamp_scales_its_light():
    obj, _, emission = shining("POINT")
    emission.inputs["Color"].default_value, emission.inputs["Strength"].default_value = (1, 0.5, 0.25, 1), 3
    assert_as_in_cycles(obj, 0.05, POINTS[:1])


@pytest.mark.parametrize("node", ["ShaderNodeTexWhiteNoise", "ShaderNodeBump", "ShaderNodeNewGeometry"])
def test_a_lamp_has_no_surface_and_nodes_that_ask_for_one_still_convert(node):
    obj, tree, _ = shining("POINT")
    shader, asks = tree.nodes.new("ShaderNodeBsdfPrincipled"), tree.nodes.new(node)
    if "Vector" in asks.inputs:
        tree.links.new(tree.nodes.new("ShaderNodeUVMap").outputs[0], asks.inputs["Vector"])
    tree.links.new(asks.outputs[0], shader.inputs["Emission Color"])
    shader.inputs["Emission Strength"].default_value = 2
    tree.links.new(shader.outputs[0], tree.nodes["Light Output"].inputs["Surface"])
    assert np.isfinite(converted(obj).emission).all()


@pytest.mark.parametrize("kind, output, smooth, approximated", [
    ("POINT", "Quadratic", 0.0, False), ("POINT", "Quadratic", 3.0, True), ("POINT", "Linear", 0.0, True),
    ("POINT", "Constant", 0.5, True), ("SUN", "Constant", 0.0, False)])
def test_light_falloff_is_right_at_the_middle(kind, output, smooth, approximated):
    (obj, tree, emission), report = shining(kind), Report()
    node = tree.nodes.new("ShaderNodeLightFalloff")
    node.inputs["Strength"].default_value, node.inputs["Smooth"].default_value = 2, smooth
    tree.links.new(node.outputs[output], emission.inputs["Strength"])
    assert_as_in_cycles(obj, 0.05, POINTS[:1], report)
    assert bool(report.entries) == approximated


def add_ies(tree, polar, around, candela):
    text, node = bpy.data.texts.new("profile.ies"), tree.nodes.new("ShaderNodeTexIES")
    rows = ["\n".join(" ".join(f"{value:g}" for value in row) for row in np.atleast_2d(numbers))
            for numbers in (polar, around, candela)]
    text.write(IES.format(rows=len(polar), columns=len(around), polar=rows[0], around=rows[1], candela=rows[2]))
    node.mode, node.ies = "INTERNAL", text
    tree.links.new(node.outputs["Fac"], tree.nodes["Emission"].inputs["Strength"])
    return text


POLAR = np.arange(0, 181, 5.0)
NARROW = 1000 * np.cos(np.radians(POLAR).clip(0, np.pi / 2)) ** 6
SIDES = np.arange(0, 181, 20.0)
TILTED = 1000 * (np.cos(np.radians(POLAR)) * np.cos(0.5) + np.sin(np.radians(POLAR)) * np.sin(0.5)
                 * np.cos(np.radians(SIDES))[:, None]).clip(0) ** 8


@pytest.mark.parametrize("kind, around, candela, tolerance", [
    ("POINT", [0], [NARROW], 0.16), ("SPOT", [0], [NARROW], 0.16), ("AREA", [0], [NARROW], 0.16),
    ("POINT", SIDES, TILTED, 0.4)])
def test_ies_profile_sends_its_light_where_cycles_does(kind, around, candela, tolerance):
    (obj, tree, _), report = shining(kind), Report()
    add_ies(tree, POLAR, around, candela)
    assert_as_in_cycles(obj, tolerance, report=report)
    assert "cones" in report.lines()[0]


def test_an_even_ies_profile_is_no_beam_and_a_broken_one_is_dark_by_name():
    (obj, tree, _), report = shining("POINT"), Report()
    text = add_ies(tree, [0, 90, 180], [0], [500, 500, 500])
    assert_as_in_cycles(obj, 0.05)
    assert len(converted(obj)) == 20
    text.from_string("no profile")
    assert len(converted(obj, report)) == 0 and "cannot be read" in report.lines()[0]


def test_a_texture_on_an_area_lamp_shines_from_where_it_is():
    obj, tree, emission = shining("AREA")
    image = bpy.data.images.new("Half", 4, 4, float_buffer=True)
    pixels = np.zeros((4, 4, 4), np.float32)
    pixels[:, 2:, 0], pixels[:2, :, 1], pixels[..., 3] = 4, 1, 1
    image.pixels.foreach_set(pixels.ravel())
    coordinate, texture = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation = image, "Closest"
    tree.links.new(coordinate.outputs["UV"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
    assert_as_in_cycles(obj, 0.04)


@pytest.mark.parametrize("change, is_rough_guess",
                         [(None, False), ("scale", True), ("falloff", True)])
def test_lamps_that_shine_otherwise_than_beams_are_a_rough_guess(change, is_rough_guess):
    obj, tree, emission = shining("SPOT")
    if change == "scale":
        obj.matrix_world = POSE @ Matrix.Diagonal((2, 0.5, 1, 1))
    elif change == "falloff":
        node = tree.nodes.new("ShaderNodeLightFalloff")
        tree.links.new(node.outputs["Constant"], emission.inputs["Strength"])
    assert converted(obj).seldom("is_rough_guess").all() == is_rough_guess
