# SPDX-License-Identifier: GPL-3.0-or-later
"""What lets light straight through: alpha, Transparent BSDF, triangles that are clear."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.scene import IOR, TRANSMISSION
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.material_tiles import MaterialTiles

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, material
from tests.rf2_engine.convert.shading.test_material_tiles import tile_of
from tests.rf2_engine.convert.triangles import triangles


@pytest.fixture(autouse=True)
def scene():
    empty_cycles_scene()


def cut_out(made, tree, shader):
    """Gives a Principled material the alpha of an image whose left half is clear."""
    image = bpy.data.images.new("Leaf", 2, 1, alpha=True, float_buffer=True)
    image.pixels.foreach_set(np.float32([1, 1, 1, 0, 1, 1, 1, 1]))
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation, texture.extension = image, "Closest", "EXTEND"
    tree.links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])


def test_triangles_that_are_clear_are_left_out_and_others_are_clear_where_alpha_says():
    made, tree, shader = material(Base_Color=(0.1, 0.6, 0.2, 1))
    cut_out(made, tree, shader)
    left = np.array([(0, 0), (0.49, 0), (0, 1)], np.float32)
    across = np.array([(0, 0), (1, 0), (0, 1)], np.float32)
    tiles = MaterialTiles(Report())
    index, emission = tiles.triangle_tiles(copied(made), triangles(3, [left, left + [0.51, 0], across]))
    assert list(index < 0) == [True, False, False] and not emission.any()
    leaf, mixed = tiles.tiles[index[1:]].astype(np.float32)
    np.testing.assert_allclose(leaf[:3, 0, 0], (0.1, 0.6, 0.2), atol=1e-3)
    assert not leaf[TRANSMISSION].any() and sorted(set(mixed[TRANSMISSION].ravel())) == [0, 1]
    np.testing.assert_array_equal(mixed[IOR][mixed[TRANSMISSION] == 1], 1)


def test_tiles_say_how_much_of_each_colour_goes_straight_through():
    leaf, tree, shader = material(Base_Color=(0.1, 0.6, 0.2, 1))
    cut_out(leaf, tree, shader)
    pane, _, _ = material("ShaderNodeBsdfTransparent", Color=(0.8, 0.4, 0.2, 1))
    glass, _, _ = material(Transmission_Weight=1.0)
    tiles = MaterialTiles(Report())
    across = np.array([(0, 0), (1, 0), (0, 1)], np.float32)
    index = np.concatenate([tiles.triangle_tiles(copied(made), triangles(1, [across]))[0]
                            for made in (leaf, pane, glass)])
    clear = tiles.extras["clear"][index]
    np.testing.assert_allclose(clear, [(0.75, 0.75, 0.75), (0.8, 0.4, 0.2), (0, 0, 0)], atol=0.02)


def test_half_an_alpha_lets_through_half_of_the_light():
    made, _, _ = material(Base_Color=(0.2, 0.2, 0.2, 1), Alpha=0.5, Specular_IOR_Level=0.0, Roughness=1.0)
    tile, _ = tile_of(made)
    assert tile[0] * tile[TRANSMISSION] == pytest.approx(0.5, abs=0.01)
    assert tile[0] * (1 - tile[TRANSMISSION]) == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize("shader, inputs", [("ShaderNodeBsdfPrincipled", dict(Alpha=0.0)),
                                            ("ShaderNodeBsdfTransparent", {})])
def test_invisible_materials_leave_nothing(shader, inputs):
    made, _, _ = material(shader, **inputs)
    assert (MaterialTiles(Report()).triangle_tiles(copied(made), triangles(2))[0] == -1).all()
    glowing, tree, add = material("ShaderNodeAddShader", "Glow")
    for i, kind in enumerate(("Emission", "BsdfTransparent")):
        tree.links.new(tree.nodes.new("ShaderNode" + kind).outputs[0], add.inputs[i])
    index, emission = MaterialTiles(Report()).triangle_tiles(copied(glowing), triangles(2))
    assert (index >= 0).all() and emission.all()


def test_a_colour_that_is_no_number_lets_nothing_through_and_is_reported():
    pane, _, _ = material("ShaderNodeBsdfTransparent", Color=(float("nan"), 0.4, 0.2, 1))
    report = Report()
    tiles = MaterialTiles(report)
    index, _ = tiles.triangle_tiles(copied(pane), triangles(2))
    np.testing.assert_allclose(tiles.extras["clear"][index], [(0, 0.4, 0.2)] * 2, atol=1e-6)
    assert any("its transparency has values that are infinite" in line for line in report.lines())
