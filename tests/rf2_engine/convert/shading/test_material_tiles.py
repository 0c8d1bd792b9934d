# SPDX-License-Identifier: GPL-3.0-or-later
"""Shaders as tile parameters: values, emission, groups, mixing and what is reported."""
import re

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.scene import (
    EMISSION_SIZE,
    HEIGHT,
    ROUGHNESS,
    barycentric_grid,
    constant_tile,
)
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.meshes import read_mesh
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import Instance
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.appearance import find_appearance
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.functions import FUNCTIONS
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.layers import effective_ior
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.material_tiles import MaterialTiles
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.spectrum import blackbody_color
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.volume import has_surface, volume_coefficients

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, material
from tests.rf2_engine.convert.triangles import triangles

UV = np.float32([[(0, 0), (1, 0), (0, 1)]])


@pytest.fixture(autouse=True)
def scene():
    empty_cycles_scene()


def tile_of(made, report=None, uv=None):
    """(11,) parameters and (3,) radiance of a homogeneous material."""
    tiles = MaterialTiles(report or Report())
    index, emission = tiles.triangle_tiles(copied(made), triangles(3, None if uv is None else np.repeat(uv, 3, axis=0)))
    assert len(tiles.tiles) <= 2 and len(set(index)) == 1
    tile = tiles.tiles[index[0]]
    assert (tile == tile[:, :1, :1]).all()
    return tile[:, 0, 0].astype(np.float32), emission[0]


def assert_tile(made, report=None, **expected):
    tile, emission = tile_of(made, report)
    np.testing.assert_allclose(tile, constant_tile(**expected)[:, 0, 0].astype(np.float32), atol=2e-3)
    return emission


def test_light_may_differ_from_face_to_face_and_not_within_one():
    made, tree, emission = material("ShaderNodeEmission", Strength=2.0)
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["True Normal"], emission.inputs["Color"])
    faces = triangles(2)
    faces.corners[1] = faces.corners[1][:, [1, 2, 0]]
    _, light = MaterialTiles(Report()).triangle_tiles(copied(made), faces)
    np.testing.assert_allclose(light.max(axis=1), 2, atol=1e-3)
    assert len(np.unique(light.argmax(axis=1))) == 2


@pytest.mark.parametrize("ior, level, expected", [(1.5, 0.5, 1.329431), (1.45, 0.5, 1.29852), (1.33, 0.5, 1.22259),
                                                  (1.8, 0.5, 1.50636), (1.5, 1.0, 1.5), (1.5, 0.0, 1.0)])
def test_effective_ior(ior, level, expected):
    assert effective_ior(np.float64(ior), np.float64(level)) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("kind, inputs, expected", [
    ("ShaderNodeBsdfPrincipled", {}, (0.5, 1.5, 4)), ("ShaderNodeBsdfDiffuse", {}, (0.5, 1.5, 4)),
    ("ShaderNodeBsdfPrincipled", {"Metallic": 1.0}, (0.5, 1, 1)),
    ("ShaderNodeBsdfPrincipled", {"Transmission_Weight": 1.0}, (0.5, 1, 1)),
    ("ShaderNodeBsdfPrincipled", {"Subsurface_Weight": 1.0}, (0.5, 1, 1)),
    ("ShaderNodeBsdfGlossy", {}, (0.5, 1.5, 4)), ("ShaderNodeSubsurfaceScattering", {}, (0.5, 1, 1))])
def test_colors_above_one_count_where_cycles_counts_them(kind, inputs, expected):
    color = "Base_Color" if kind == "ShaderNodeBsdfPrincipled" else "Color"
    made, _, _ = material(kind, **{color: (0.5, 1.5, 4, 1)}, **inputs)
    np.testing.assert_allclose(tile_of(made)[0][:3], expected, atol=2e-3)


def test_principled_constants():
    opaque, _, _ = material(Base_Color=(0.1, 0.2, 0.3, 1), Metallic=0.25, Roughness=0.4)
    assert_tile(opaque, base_color=(0.1, 0.2, 0.3), metallic=0.25, roughness=0.4, ior=1.3294)
    glass, _, _ = material(Transmission_Weight=1.0, IOR=1.33, Roughness=0.1)
    assert_tile(glass, base_color=(0.8, 0.8, 0.8), roughness=0.1, ior=1.33, transmission=1)
    air_in_water, _, _ = material(Transmission_Weight=1.0, IOR=0.75, Roughness=0.1)
    assert_tile(air_in_water, base_color=(0.8, 0.8, 0.8), roughness=0.1, ior=0.75, transmission=1)
    partly, _, _ = material(Transmission_Weight=0.25)
    assert_tile(partly, base_color=(0.8, 0.8, 0.8), roughness=0.5, ior=0.75 * 1.3294 + 0.25 * 1.5, transmission=0.25)


def test_other_shaders():
    gray = (0.5, 0.5, 0.5)
    assert_tile(None, base_color=(0.8, 0.8, 0.8))
    assert_tile(material("ShaderNodeBsdfDiffuse", Color=(0.1, 0.2, 0.3, 1))[0], base_color=(0.1, 0.2, 0.3))
    assert_tile(material("ShaderNodeBsdfGlossy", Color=(*gray, 1), Roughness=0.2)[0],
                base_color=gray, metallic=1, roughness=0.2)
    assert_tile(material("ShaderNodeBsdfGlass", Color=(*gray, 1), Roughness=0.2)[0],
                base_color=(0.25, 0.25, 0.25), roughness=0.2, ior=1.5, transmission=1)


def test_mix_of_diffuse_and_glossy_is_partly_metallic():
    made, tree, mix = material("ShaderNodeMixShader", Fac=0.25)
    diffuse, glossy = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeBsdfGlossy")
    diffuse.inputs["Color"].default_value = glossy.inputs["Color"].default_value = (0.6, 0.6, 0.6, 1)
    glossy.inputs["Roughness"].default_value = 0.3
    tree.links.new(diffuse.outputs[0], mix.inputs[1])
    tree.links.new(glossy.outputs[0], mix.inputs[2])
    assert_tile(made, base_color=(0.6, 0.6, 0.6), metallic=0.25, roughness=0.3)


def test_what_shines_reflects_what_its_material_does():
    bright, _, _ = material("ShaderNodeEmission", Color=(1, 0.5, 0.25, 1), Strength=40.0)
    np.testing.assert_allclose(assert_tile(bright, base_color=(0, 0, 0)), (40, 20, 10))
    for strength in (0.5, 40):
        made, _, _ = material(Base_Color=(0.1, 0.2, 0.3, 1), Emission_Strength=strength)
        np.testing.assert_allclose(assert_tile(made, base_color=(0.1, 0.2, 0.3), roughness=0.5, ior=1.3294), strength)


def test_emission_texture_is_averaged_per_triangle():
    image = bpy.data.images.new("Halves", 2, 1, float_buffer=True)
    image.pixels.foreach_set(np.array([0, 0, 0, 1, 1, 1, 1, 1], np.float32))
    made, tree, shader = material("ShaderNodeEmission", Strength=8.0)
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation = image, "Closest"
    tree.links.new(texture.outputs[0], shader.inputs["Color"])
    left = np.array([(0, 0), (0.5, 0), (0, 1)], np.float32)
    across = np.array([(0, 0), (1, 0), (0.5, 1)], np.float32)
    uv = np.stack([left, left + [0.5, 0], across]).astype(np.float32)
    tiles = MaterialTiles(Report())
    index, emission = tiles.triangle_tiles(copied(made), triangles(3, uv))
    np.testing.assert_allclose(emission[:, 0], [0, 8, 4], atol=0.15)
    assert not tiles.tiles[index, 0].any()


def shining_image(uv):
    """A material that shines by an image of two dark and two bright quarters, and triangles with UVs (n, 3, 2)."""
    image = bpy.data.images.new("Quarters", 64, 64, float_buffer=True)
    pixels = np.zeros((64, 64, 4), np.float32)
    pixels[:32, 32:], pixels[32:, :32, 0], pixels[..., 3] = 1, 1, 1
    image.pixels.foreach_set(pixels.ravel())
    made, tree, shader = material("ShaderNodeEmission", Strength=8.0)
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    tree.links.new(texture.outputs[0], shader.inputs["Color"])
    return copied(made), triangles(len(uv), uv)


def test_emission_that_varies_within_a_triangle_is_kept_on_a_fine_grid():
    corners = np.float32([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]])
    made, mesh = shining_image(corners)
    tiles = MaterialTiles(Report())
    appearance = find_appearance(tiles, made, mesh, Instance())
    index, emission = appearance.emission_tile, appearance.emission
    assert (index >= 0).all()
    grid = barycentric_grid(EMISSION_SIZE)
    inside = grid[..., 2] > -1e-6
    for triangle in range(2):
        u, v = np.moveaxis(grid[inside] @ corners[triangle], -1, 0)
        away = (np.abs(u - 0.5) > 0.03) & (np.abs(v - 0.5) > 0.03)
        radiance = tiles.emission_tiles[index[triangle]][:, inside].T * emission[triangle]
        expected = np.where((u > 0.5) & (v < 0.5), 8, np.float32([[1], [0], [0]]) * 8 * ((u < 0.5) & (v > 0.5))).T
        np.testing.assert_allclose(radiance[away], expected[away], atol=0.05)


def test_even_emission_has_no_grid():
    made, mesh = shining_image(np.float32([[(0.6, 0.1), (0.9, 0.1), (0.6, 0.4)]]))
    even, _, _ = material("ShaderNodeEmission", Strength=8.0)
    tiles = MaterialTiles(Report())
    for each in made, copied(even):
        assert find_appearance(tiles, each, mesh, Instance()).emission_tile.tolist() == [-1]
    assert tiles.emission_tiles is None


def test_values_come_through_groups_reroutes_and_muted_nodes():
    made, tree, shader = material()
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    group.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
    entry, leave, invert = (group.nodes.new(n) for n in ("NodeGroupInput", "NodeGroupOutput", "ShaderNodeInvert"))
    group.links.new(entry.outputs[0], invert.inputs["Color"])
    group.links.new(invert.outputs[0], leave.inputs[0])
    color, reroute, user = (tree.nodes.new(n) for n in ("ShaderNodeRGB", "NodeReroute", "ShaderNodeGroup"))
    user.node_tree, color.outputs[0].default_value = group, (0.9, 0.8, 0.7, 1)
    tree.links.new(color.outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], user.inputs[0])
    tree.links.new(user.outputs[0], shader.inputs["Base Color"])
    np.testing.assert_allclose(tile_of(made)[0][:3], (0.1, 0.2, 0.3), atol=1e-3)
    invert.mute = True
    np.testing.assert_allclose(tile_of(made)[0][:3], (0.9, 0.8, 0.7), atol=1e-3)


def test_active_output_for_cycles_wins():
    made, tree, _ = material(Base_Color=(1, 0, 0, 1))
    other, diffuse = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (0, 1, 0, 1)
    tree.links.new(diffuse.outputs[0], other.inputs["Surface"])
    other.target = "CYCLES"
    np.testing.assert_allclose(tile_of(made)[0][:3], (0, 1, 0))


@pytest.mark.parametrize("space, scale, expected", [
    ("OBJECT", (1, 1, 1), 0.5), ("OBJECT", (2, 2, 2), 1), ("OBJECT", (0.4, 0.4, 1.5), 0.75), ("WORLD", (2, 2, 2), 0.5)])
def test_displacement_becomes_height(space, scale, expected):
    """Measured in Cycles: a plane at 0.1 above midlevel rises by that times its scale along its normal, in space OBJECT
    alone."""
    made, tree, _ = material()
    made.displacement_method = "BOTH"
    node = tree.nodes.new("ShaderNodeDisplacement")
    node.space = space
    for name, value in (("Height", 0.75), ("Midlevel", 0.5), ("Scale", 0.05)):
        node.inputs[name].default_value = value
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    tree.links.new(node.outputs[0], output.inputs["Displacement"])
    tiles = MaterialTiles(Report())
    index, _ = tiles.triangle_tiles(copied(made), triangles(2), Instance(np.diag([*scale, 1.0])))
    np.testing.assert_allclose(tiles.tiles[index, HEIGHT], expected, atol=1e-3)


def test_vertex_colours_vary_inside_a_triangle():
    made, tree, shader = material()
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "Paint"
    tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    tiles = MaterialTiles(Report())
    index, _ = tiles.triangle_tiles(copied(made), triangles(1, attributes={"Paint": np.eye(3, 4)[None]}))
    tile = tiles.tiles[index[0]].astype(np.float32)
    np.testing.assert_allclose(tile[:3, 0, 31], (0.984375, 0.015625, 0), atol=1e-3)
    np.testing.assert_allclose(tile[:3, 0, 0], (0.015625, 0.015625, 0.96875), atol=1e-3)


def in_group(tree, kind):
    """Output of a node of a new group in the tree."""
    group = bpy.data.node_groups.new("Inside", "ShaderNodeTree")
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketFloat")
    node, leave = group.nodes.new(kind), group.nodes.new("NodeGroupOutput")
    group.links.new(node.outputs[0], leave.inputs[0])
    user = tree.nodes.new("ShaderNodeGroup")
    user.node_tree = group
    return user.outputs[0]


def test_an_input_keeps_its_value_where_the_node_before_cannot_be_evaluated():
    made, tree, shader = material(name="Rock", Base_Color=(0.1, 0.2, 0.3, 1), Roughness=0.35)
    tree.links.new(tree.nodes.new("ShaderNodeUVAlongStroke").outputs[0], shader.inputs["Base Color"])
    tree.links.new(in_group(tree, "ShaderNodeWireframe"), shader.inputs["Roughness"])
    report = Report()
    assert_tile(made, report, base_color=(0.1, 0.2, 0.3), roughness=0.35, ior=1.3294)
    stroke, wire = report.lines()
    assert all(word in stroke for word in ("Rock", "UV Along Stroke", '"Base Color" of "Principled BSDF" keeps'))
    assert all(word in wire for word in ("Rock", '"Wireframe" in "Inside"', '"Roughness" of "Principled BSDF" keeps'))


def test_every_node_of_blender_is_evaluated_or_reported():
    made, tree, shader = material(name="Rock")
    seen = 0
    for kind in filter(re.compile("ShaderNode.").match, dir(bpy.types)):
        try:
            node = tree.nodes.new(kind)
        except RuntimeError:
            continue  # a base class
        if node.outputs and node.outputs[0].type != "SHADER":
            tree.links.new(node.outputs[0], shader.inputs["Roughness"])
            report = Report()
            MaterialTiles(report).triangle_tiles(copied(made), triangles(1, UV))
            assert kind in FUNCTIONS or any("keeps its own value" in line for line in report.lines()), kind
            seen += 1
    assert seen > 60


def test_a_report_names_the_material():
    made, tree, shader = material(name="Rock", Coat_Weight=1.0)
    report = Report()
    tile_of(made, report)
    assert "Rock" in report.lines()[0] and "coat" in report.lines()[0]
    empty, tree, _ = material(name="Empty")
    tree.links.clear()
    assert_tile(empty, report, base_color=(0, 0, 0))
    assert "Empty" in report.lines()[-1]


def test_volume_coefficients_and_surfaces():
    made, tree, volume = material("ShaderNodeVolumePrincipled", Density=2.0, Color=(0.5, 0.25, 1, 1),
                                  Absorption_Color=(0, 0.25, 0, 1))
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    assert has_surface(copied(made)) and volume_coefficients(copied(made), Report()) is None
    tree.links.clear()
    tree.links.new(volume.outputs[0], output.inputs["Volume"])
    scattering, absorption = volume_coefficients(copied(made), Report())
    np.testing.assert_allclose(scattering, (1, 0.5, 2))
    np.testing.assert_allclose(absorption, (1, 0.75, 0))
    assert not has_surface(copied(made)) and has_surface(None)
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], output.inputs["Surface"])
    assert not has_surface(copied(made))


@pytest.mark.parametrize("kelvin", [500, 1500, 3000, 6500, 10000, 20000])
def test_black_bodies_have_blenders_colour(kelvin):
    light = bpy.data.lights.new("Lamp", "POINT")
    light.use_temperature, light.temperature = True, kelvin
    bpy.context.view_layer.update()
    np.testing.assert_allclose(blackbody_color(np.array([kelvin])), light.temperature_color, rtol=0.005, atol=0.005)


@pytest.mark.parametrize("output, expected", [("Color", (0.1, 0.2, 0.6)), ("Alpha", (0.25,) * 3), ("Fac", (0.3,) * 3)])
def test_colour_attribute_without_a_name_is_the_one_that_renders(output, expected):
    made, tree, shader = material("ShaderNodeEmission", Strength=1.0)
    mesh = bpy.data.meshes.new("Painted")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    for name, color in (("First", (1, 1, 1, 1)), ("Second", (0.1, 0.2, 0.6, 0.25))):
        layer = mesh.color_attributes.new(name, "FLOAT_COLOR", "POINT")
        layer.data.foreach_set("color", np.tile(np.float32(color), 4))
    mesh.color_attributes.render_color_index = 1
    node = tree.nodes.new("ShaderNodeAttribute" if output == "Fac" else "ShaderNodeVertexColor")
    if output == "Fac":
        node.attribute_name = "Second"
    tree.links.new(node.outputs[output], shader.inputs["Color"])
    _, emission = MaterialTiles(Report()).triangle_tiles(copied(made), read_mesh(mesh, "Painted", Report()))
    np.testing.assert_allclose(emission[0], expected, atol=1e-5)


def test_hair_of_one_color_is_the_same_by_its_color_and_its_melanin():
    def tile(parametrization, **inputs):
        made, _, node = material("ShaderNodeBsdfHairPrincipled")
        node.parametrization = parametrization
        for name, value in inputs.items():
            node.inputs[name].default_value = value
        tiles = MaterialTiles(Report())
        index, _ = tiles.triangle_tiles(copied(made), triangles(1))
        through = tiles.extras["translucent"][index]
        assert tiles.extras["fibre"][index] == 1 and (through > 0).all() and (through < 1).all()
        return tiles.tiles[index[0], :3, 0, 0].astype(np.float32)

    blond, dark = tile("MELANIN", Melanin=0.15), tile("MELANIN", Melanin=0.95)
    assert (dark < 0.6 * blond).all() and blond[0] > blond[2] + 0.1
    np.testing.assert_allclose(tile("COLOR", Color=(1, 1, 1, 1)), 1, atol=0.01)
    np.testing.assert_allclose(tile("ABSORPTION", **{"Absorption Coefficient": (0, 0, 0)}), 1, atol=0.01)


@pytest.mark.parametrize("kind, inputs, expected", [
    ("ShaderNodeBsdfDiffuse", dict(Roughness=0.5), 0.5), ("ShaderNodeBsdfDiffuse", {}, 0),
    ("ShaderNodeSubsurfaceScattering", {}, 0), ("ShaderNodeBsdfToon", {}, 1), ("ShaderNodeBsdfRefraction", {}, 1),
    ("ShaderNodeBsdfPrincipled", {}, 0), ("ShaderNodeBsdfPrincipled", dict(Anisotropic=0.8), 0.8),
    ("ShaderNodeBsdfPrincipled", dict(Diffuse_Roughness=0.6), 0.6)])
def test_tiles_say_how_much_of_a_surface_has_a_lobe_of_another_shape(kind, inputs, expected):
    tiles = MaterialTiles(Report())
    index, _ = tiles.triangle_tiles(copied(material(kind, **inputs)[0]), triangles(1))
    guessed = tiles.extras["guessed"]
    assert (0 if guessed is None else guessed[index[0]]) == pytest.approx(expected)


@pytest.mark.parametrize("kind, distribution, expected", [
    ("ShaderNodeBsdfPrincipled", "MULTI_GGX", 0), ("ShaderNodeBsdfPrincipled", "GGX", 1),
    ("ShaderNodeBsdfGlossy", "BECKMANN", 1), ("ShaderNodeBsdfMetallic", "GGX", 1), ("ShaderNodeBsdfDiffuse", None, 0)])
def test_tiles_say_whether_their_facets_light_each_other(kind, distribution, expected):
    made, _, node = material(kind)
    if distribution:
        node.distribution = distribution
    tiles = MaterialTiles(Report())
    index, _ = tiles.triangle_tiles(copied(made), triangles(1))
    single = tiles.extras["single"]
    assert (0 if single is None else single[index[0]]) == pytest.approx(expected)


def test_tiles_say_what_coat_and_sheen_are():
    tiles = MaterialTiles(Report())
    made = material(Roughness=0.5, Coat_Weight=0.8, Coat_Roughness=0.1, Sheen_Weight=0.5, Sheen_Roughness=0.7,
                    Sheen_Tint=(1, 0.5, 0, 1))[0]
    index, _ = tiles.triangle_tiles(copied(made), triangles(1))
    np.testing.assert_allclose(tiles.extras["sheen"][index[0]], (0.5, 0.25, 0, 0.7), atol=1e-5)
    share = 0.8 / 1.8  # coat and layer reflect 0.04 each
    np.testing.assert_allclose(tiles.extras["coat"][index[0]], (0.8, 0.04, 0.1, share), atol=1e-3)
    roughness = tiles.tiles[index[0], ROUGHNESS, 0, 0]
    assert (float(roughness) - share * 0.1) / (1 - share) == pytest.approx(0.5, abs=2e-3)


def test_translucent_light_has_a_color_of_its_own():
    made, tree, add = material("ShaderNodeAddShader")
    for node, color, input in zip(("ShaderNodeBsdfDiffuse", "ShaderNodeBsdfTranslucent"),
                                  ((0.1, 0.3, 0.2, 1), (0.3, 0.3, 0, 1)), add.inputs, strict=True):
        shader = tree.nodes.new(node)
        shader.inputs["Color"].default_value = color
        tree.links.new(shader.outputs[0], input)
    tiles = MaterialTiles(Report())
    index, _ = tiles.triangle_tiles(copied(made), triangles(1))
    assert tiles.extras["translucent"][index[0]] == pytest.approx([0.75, 0.5, 0], abs=1e-3)


@pytest.mark.parametrize("cut", [None, 0.5, "ShaderNodeTexChecker"])
def test_holes_leave_what_is_there_as_translucent_as_it_is(cut):
    made, tree, mix = material("ShaderNodeMixShader", Fac=0.25)
    for node, input in zip(("ShaderNodeBsdfDiffuse", "ShaderNodeBsdfTranslucent"), mix.inputs[1:], strict=True):
        tree.links.new(tree.nodes.new(node).outputs[0], input)
    if cut:
        holes = tree.nodes.new("ShaderNodeMixShader")
        holes.inputs["Fac"].default_value = 0.5
        if cut != 0.5:
            tree.links.new(tree.nodes.new(cut).outputs["Fac"], holes.inputs["Fac"])
        tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], holes.inputs[1])
        tree.links.new(mix.outputs[0], holes.inputs[2])
        tree.links.new(holes.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    tiles = MaterialTiles(Report())
    index, _ = tiles.triangle_tiles(copied(made), triangles(1))
    assert tiles.extras["translucent"][index] == pytest.approx(0.25, abs=1e-3)
    assert cut is None or tiles.extras["clear"][index].mean() == pytest.approx(0.5, abs=0.05)
