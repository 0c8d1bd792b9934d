# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture tiles against what Cycles shows of the same node graph, texel by texel."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model import progress
from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR, NORMAL, ROUGHNESS
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import Instance
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.material_tiles import MaterialTiles
from mathutils import Euler, Matrix

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, material, seen_flat_on
from tests.rf2_engine.convert.triangles import triangles

LOW, HIGH = -0.6, 1.7  # UV range of the square that both pictures show


@pytest.fixture
def image():
    """8 x 6 texels with a dark red, a green, a blue and a pale quarter and a little noise."""
    empty_cycles_scene(samples=1)
    made = bpy.data.images.new("Quarters", 8, 6)
    pixels = np.random.default_rng(1).uniform(0.0, 0.1, (6, 8, 4)).astype(np.float32)
    pixels[:3, :4, 0] += 0.4
    pixels[:3, 4:, 1] += 0.6
    pixels[3:, :4, 2] += 0.9
    pixels[3:, 4:, :3] += 0.7
    pixels[..., 3] = 1
    return stored(made, pixels, "Non-Color")


def stored(image, pixels, space):
    """The colour space first: setting it drops the pixels of a generated image."""
    image.colorspace_settings.name = space
    image.pixels.foreach_set(np.asarray(pixels, np.float32).ravel())
    return image


def graph(tree, image, *chain):
    """UV -> Image Texture -> the nodes of `chain`, each (kind, settings, inputs by number); returns the last output."""
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    output = texture.outputs["Color"]
    for kind, settings, inputs in chain:
        node = tree.nodes.new(kind)
        for key, value in settings.items():
            setattr(node, key, value)
        for index, value in inputs.items():
            if value is None:
                tree.links.new(output, node.inputs[index])
            else:
                node.inputs[index].default_value = value
        output = next(o for o in node.outputs if o.enabled)
    return texture, output


def tile_and_picture(build, report=None):
    """(3, 32, 32) base colour of one triangle and the same square in Cycles, both with row 0 at V = LOW."""
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = 32
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    shown, tree, emission = material("ShaderNodeEmission", "Shown", Strength=1.0)
    tree.links.new(build(tree), emission.inputs["Color"])
    corners = np.array([(-1, -1), (3, -1), (3, 3), (-1, 3)]) / 2
    picture = seen_flat_on(shown, 4.0, uv=LOW + (HIGH - LOW) * corners)
    made, tree, diffuse = material("ShaderNodeBsdfDiffuse", "Made")
    tree.links.new(build(tree), diffuse.inputs["Color"])
    tiles = MaterialTiles(report or Report())
    uv = np.array([[(HIGH, LOW), (LOW, HIGH), (LOW, LOW)]], np.float32)
    index, _ = tiles.triangle_tiles(copied(made), triangles(1, uv))
    return tiles.tiles[index[0], BASE_COLOR].astype(np.float32), np.moveaxis(picture, -1, 0)


def assert_same(tile, picture, share=1.0, atol=4e-3):
    close = np.isclose(tile, np.clip(picture, 0, 1), atol=atol).all(axis=0)
    assert picture.std() > 0.05
    assert close.mean() >= share, f"{close.mean():.3f} of the texels agree"


def test_four_colours_land_at_the_right_tile_corners():
    empty_cycles_scene()
    image = bpy.data.images.new("Four", 2, 2)
    stored(image, [[(1, 0, 0, 1), (0, 1, 0, 1)], [(0, 0, 1, 1), (1, 1, 1, 1)]], "Non-Color")  # V = 0 first
    made, tree, shader = material("ShaderNodeBsdfPrincipled")
    texture, color = graph(tree, image)
    texture.interpolation = "Closest"
    tree.links.new(color, shader.inputs["Base Color"])
    tiles = MaterialTiles(Report())
    uv = np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]], np.float32)
    index, emission = tiles.triangle_tiles(copied(made), triangles(2, uv))
    first, second = tiles.tiles[index, BASE_COLOR].astype(np.float32)
    assert not emission.any()
    np.testing.assert_array_equal(first[:, 0, 31], (1, 0, 0))   # corner 0, UV (0, 0)
    np.testing.assert_array_equal(first[:, 31, 0], (0, 1, 0))   # corner 1, UV (1, 0)
    np.testing.assert_array_equal(first[:, 0, 0], (1, 1, 1))    # corner 2, UV (1, 1)
    np.testing.assert_array_equal(second[:, 0, 0], (0, 0, 1))   # corner 2, UV (0, 1)


@pytest.mark.parametrize("extension", ["REPEAT", "EXTEND", "CLIP", "MIRROR"])
@pytest.mark.parametrize("interpolation", ["Linear", "Closest"])
def test_extension_and_interpolation_match_cycles(image, extension, interpolation):
    def build(tree):
        texture, color = graph(tree, image)
        texture.extension, texture.interpolation = extension, interpolation
        return color

    assert_same(*tile_and_picture(build), share=1.0 if interpolation == "Linear" else 0.97)


HALF = "ShaderNodeMath", dict(operation="MULTIPLY"), {0: None, 1: 0.5}
VECTOR = "ShaderNodeVectorMath", dict(operation="ADD"), {0: None, 1: (0.1, 0.2, 0.3)}


@pytest.mark.parametrize("chain", [(HALF,), (VECTOR, HALF)], ids=["colour", "vector"])
def test_values_become_numbers_as_in_cycles(image, chain):
    assert_same(*tile_and_picture(lambda tree: graph(tree, image, *chain)[1]), share=0.97)


def test_srgb_images_are_decoded(image):
    stored(image, image.pixels[:], "sRGB")

    def build(tree):
        texture, color = graph(tree, image)
        texture.interpolation = "Closest"
        return color

    assert_same(*tile_and_picture(build), share=0.97)


@pytest.mark.parametrize("uses_alpha", [False, True])
def test_alpha_is_associated_as_in_cycles(image, uses_alpha):
    pixels = np.array(image.pixels[:]).reshape(-1, 4)
    pixels[::2, 3] = 0.5
    stored(image, pixels, "sRGB")

    def build(tree):
        texture, color = graph(tree, image)
        texture.interpolation = "Closest"
        if not uses_alpha:
            return color
        mix = tree.nodes.new("ShaderNodeMixRGB")
        tree.links.new(texture.outputs["Alpha"], mix.inputs["Fac"])
        tree.links.new(color, mix.inputs["Color2"])
        return mix.outputs[0]

    assert_same(*tile_and_picture(build), share=0.97, atol=0.02)  # Cycles divides 8-bit values by alpha again


def test_many_texels_per_cell_are_averaged():
    empty_cycles_scene()
    image = bpy.data.images.new("Noise", 512, 512, float_buffer=True)
    noise = np.random.default_rng(0).uniform(0, 1, (512, 512, 4)).astype(np.float32)
    image.pixels.foreach_set(noise.ravel())
    made, tree, shader = material("ShaderNodeBsdfDiffuse")
    tree.links.new(graph(tree, image)[1], shader.inputs["Color"])
    tiles = MaterialTiles(Report())
    uv = np.array([[(1, 0), (0, 1), (0, 0)]], np.float32)
    index, _ = tiles.triangle_tiles(copied(made), triangles(1, uv))
    blocks = noise[..., :3].reshape(32, 16, 32, 16, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(np.moveaxis(tiles.tiles[index[0], BASE_COLOR], 0, -1), blocks, atol=2e-3)


def test_normal_map_and_roughness_reach_their_channels(image):
    made, tree, shader = material("ShaderNodeBsdfPrincipled")
    texture, color = graph(tree, image)
    texture.interpolation = "Closest"
    normal, separate = tree.nodes.new("ShaderNodeNormalMap"), tree.nodes.new("ShaderNodeSeparateColor")
    normal.inputs["Strength"].default_value = 0.5
    tree.links.new(color, normal.inputs["Color"])
    tree.links.new(color, separate.inputs["Color"])
    tree.links.new(normal.outputs[0], shader.inputs["Normal"])
    tree.links.new(separate.outputs["Green"], shader.inputs["Roughness"])
    tiles = MaterialTiles(Report())
    uv = np.array([[(1, 0), (0, 1), (0, 0)]], np.float32)
    index, _ = tiles.triangle_tiles(copied(made), triangles(1, uv))
    tile = tiles.tiles[index[0]].astype(np.float32)
    pixels = np.array(image.pixels[:]).reshape(6, 8, 4)
    np.testing.assert_allclose(tile[ROUGHNESS, 0, [0, 31]], pixels[0, [0, 7], 1], atol=1e-3)
    mapped = 2 * pixels[0, 7, :3] - 1
    np.testing.assert_allclose(tile[NORMAL, 0, 31], 0.5 * mapped + 0.5 * np.array([0, 0, 1]), atol=2e-3)


def test_a_normal_map_of_another_uv_map_bends_in_the_frame_of_the_active_one():
    """The other map lies a quarter turn away: where it tilts along its U, the active one tilts along V."""
    empty_cycles_scene()
    made, tree, shader = material("ShaderNodeBsdfDiffuse")
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.uv_map, node.inputs["Color"].default_value = "Other", (0.8, 0.5, 0.9, 1)
    tree.links.new(node.outputs[0], shader.inputs["Normal"])
    mesh = triangles(1, np.float32([[(1, 0), (0, 1), (0, 0)]]))
    mesh.uv["Other"] = np.float32([[(0, -1), (1, 0), (0, 0)]])
    tiles = MaterialTiles(Report())
    index, _ = tiles.triangle_tiles(copied(made), mesh)
    tilted = np.float32((0, 0.6, 0.8))
    np.testing.assert_allclose(tiles.tiles[index[0], NORMAL, 5, 5], tilted / np.linalg.norm(tilted), atol=2e-3)


@pytest.mark.parametrize("uv, size, expected", [
    ([(1, 0), (0, 1), (0, 0)], 1, (-0.2, 0)), ([(1, 0), (0, 1), (0, 0)], 2, (-0.1, 0)),
    ([(0, 1), (1, 0), (0, 0)], 1, (-0.2, 0)), ([(1, 1), (0, 0), (0, 1)], 1, (-0.2, 0))], ids=str)
def test_a_bump_becomes_a_tile_of_normals(uv, size, expected):
    """U rises by 1 over 2 units, whichever way the UV map lies: a slope of 0.2 at a distance of 0.4."""
    empty_cycles_scene()
    made, tree, shader = material("ShaderNodeBsdfDiffuse")
    bump, at = tree.nodes.new("ShaderNodeBump"), tree.nodes.new("ShaderNodeSeparateXYZ")
    bump.inputs["Distance"].default_value, bump.inputs["Strength"].default_value = 0.4, 1
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], at.inputs[0])
    tree.links.new(at.outputs["X"], bump.inputs["Height"])
    tree.links.new(bump.outputs[0], shader.inputs["Normal"])
    report = Report()
    tiles = MaterialTiles(report)
    place = Instance(np.diag([size, size, size, 1.0]))
    look = copied(made)
    index, _ = tiles.triangle_tiles(look, triangles(1, np.float32([uv])), place)
    normal = np.array([*expected, 1]) / np.linalg.norm([*expected, 1])
    np.testing.assert_allclose(tiles.tiles[index[0], NORMAL], np.tile(normal[:, None, None], (1, 32, 32)), atol=2e-3)
    assert not report.entries
    moved = Instance(Matrix.LocRotScale((3, 1, 2), Euler((0.2, 0.3, 0.4)), (size,) * 3))
    assert tiles.sharing(look, place) == tiles.sharing(look, Instance(np.array(moved.matrix)))
    assert tiles.sharing(look, place) != tiles.sharing(look, Instance(3 * place.matrix))


def test_missing_file_is_magenta_and_named(tmp_path):
    empty_cycles_scene()
    image = bpy.data.images.new("Gone", 4, 4)
    image.source, image.filepath = "FILE", str(tmp_path / "gone.png")
    made, tree, shader = material("ShaderNodeBsdfPrincipled", "Wall")
    tree.links.new(graph(tree, image)[1], shader.inputs["Base Color"])
    report, uv = Report(), np.zeros((3, 3, 2), np.float32)
    tiles = MaterialTiles(report)
    index, _ = tiles.triangle_tiles(copied(made), triangles(3, uv))
    np.testing.assert_array_equal(tiles.tiles[index[0], BASE_COLOR, 7, 7], (1, 0, 1))
    assert "Wall" in report.lines()[0] and "gone.png" in report.lines()[0]


def test_missing_uv_map_is_reported(image):
    made, tree, shader = material("ShaderNodeBsdfPrincipled")
    tree.links.new(graph(tree, image)[1], shader.inputs["Base Color"])
    report = Report()
    tiles = MaterialTiles(report)
    index, _ = tiles.triangle_tiles(copied(made), triangles(4))
    assert len(set(index)) == 1 and "no UV map" in report.lines()[0]


@pytest.mark.parametrize("output", ["Generated", "Object", "of another object", "Position", "unlinked"])
def test_coordinates_of_the_mesh_match_cycles(output):
    empty_cycles_scene(samples=1)
    other = bpy.data.objects.new("Other", None)
    bpy.context.scene.collection.objects.link(other)
    other.matrix_world = Matrix.LocRotScale((0.3, 0.1, 0.2), Euler((0.2, 0.3, 0.4)), (0.5, 0.7, 0.9))

    def build(tree):
        kind = "NewGeometry" if output == "Position" else "TexCoord"
        coordinate, checker = tree.nodes.new("ShaderNode" + kind), tree.nodes.new("ShaderNodeTexChecker")
        checker.inputs["Scale"].default_value = 3.3
        if output == "unlinked":
            return checker.outputs["Color"]
        offset = tree.nodes.new("ShaderNodeVectorMath")  # away from the plane z = 0, where cells meet
        offset.inputs[1].default_value = (0.01, 0.02, 0.13)
        if output == "of another object":
            coordinate.object = other
        tree.links.new(coordinate.outputs["Object" if output == "of another object" else output], offset.inputs[0])
        tree.links.new(offset.outputs[0], checker.inputs["Vector"])
        return checker.outputs["Color"]

    report = Report()
    assert_same(*tile_and_picture(build, report), share=0.9)
    assert not report.entries


def test_progress_of_a_noise_never_goes_back():
    empty_cycles_scene()
    made, tree, shader = material("ShaderNodeEmission", Strength=1.0)
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], shader.inputs["Color"])
    fractions = []
    with progress.reporting(lambda text, fraction: fractions.append(fraction)):
        MaterialTiles(Report()).triangle_tiles(copied(made), triangles(600))
    assert fractions == sorted(fractions) and len(fractions) > 9 and len(set(fractions)) == 3
