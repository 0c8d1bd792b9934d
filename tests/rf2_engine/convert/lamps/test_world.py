# SPDX-License-Identifier: GPL-3.0-or-later
"""Direction and energy of the environment map, against Cycles and the numbers of docs/scene-input.md 7 and 13."""
from pathlib import Path

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.geometry import latlong_directions, rotation_matrix
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.lamps.world import convert_world, convert_world_light
from mathutils import Euler, Matrix

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, irradiance, world
from tests.rf2_engine.convert.token_light import gathered
from tests.rf2_engine.convert.worlds import image_world

STUDIO_LIGHTS = Path(bpy.utils.system_resource("DATAFILES"), "studiolights", "world")


def test_directions_and_rotation_match_the_specification():
    d = latlong_directions(np.arange(256), 256, 512)
    np.testing.assert_allclose(d[128, 256], (0.999962, -0.006136, -0.006136), atol=1e-6)
    np.testing.assert_allclose(d[128, 128], (0.006136, 0.999962, -0.006136), atol=1e-6)
    np.testing.assert_allclose(d[0, 0], (-0.006136, 0.000038, 0.999981), atol=1e-6)
    turned = rotation_matrix(np.radians([20, 30, 40])) @ [1, 0, 0]
    np.testing.assert_allclose(turned, (0.663414, 0.556670, -0.5), atol=1e-6)


@pytest.mark.parametrize("name, rotation", [("city.exr", (0, 0, 0)), ("sunset.exr", (0.3, 0.5, 0.7))])
def test_hdri_is_as_bright_as_in_cycles(name, rotation):
    empty_cycles_scene(samples=512)
    made, _ = image_world(bpy.data.images.load(str(STUDIO_LIGHTS / name)), rotation, strength=1.5)
    environment = convert_world(copied(made), Report())
    for normal in ((0, 0, 1), (1, 0.2, 0.3)):
        np.testing.assert_allclose(gathered(environment, normal), irradiance((0, 0, 0), normal), rtol=0.02)


def test_energy_of_a_pixel_sized_sun_survives_the_reduction():
    empty_cycles_scene()
    image = bpy.data.images.new("Sun", 4096, 2048, float_buffer=True)
    pixels = np.zeros((2048, 4096, 4), np.float32)
    pixels[1500, 1000, :3] = 5e5
    image.pixels.foreach_set(pixels.ravel())
    made, _ = image_world(image)
    environment = convert_world(copied(made), Report())
    theta = np.pi * (2048 - 1500 - 0.5) / 2048
    energy = 5e5 * np.sin(theta) * (np.pi / 2048) * (2 * np.pi / 4096)
    rows = np.sin(np.pi * (np.arange(256) + 0.5) / 256) * (np.pi / 256) * (2 * np.pi / 512)
    np.testing.assert_allclose(np.einsum("rwk,r->k", environment, rows), energy, rtol=0.01)
    np.testing.assert_array_equal(np.argwhere(environment[..., 0] == environment.max())[0], [(2047 - 1500) // 8, 125])


@pytest.mark.parametrize("projection", ["EQUIRECTANGULAR", "MIRROR_BALL"])
def test_projection_matches_cycles(projection):
    empty_cycles_scene(samples=512)
    image = bpy.data.images.new("Quarters", 64, 32, float_buffer=True)
    pixels = np.ones((32, 64, 4), np.float32)
    pixels[..., 0], pixels[..., 1] = np.linspace(0, 1, 64), np.linspace(0, 4, 32)[:, None]
    image.pixels.foreach_set(pixels.ravel())
    made, texture = image_world(image)
    texture.projection = projection
    environment = convert_world(copied(made), Report())
    for normal in ((0, 0, 1), (0.2, 1, 0.3), (-1, 0, 0)):
        np.testing.assert_allclose(gathered(environment, normal), irradiance((0, 0, 0), normal), rtol=0.02)


@pytest.mark.parametrize("vector_type, size", [("POINT", (96, 48)), ("TEXTURE", (1500, 700)), ("VECTOR", (5, 3)),
                                               ("NORMAL", (64, 64))])
@pytest.mark.parametrize("projection", ["EQUIRECTANGULAR", "MIRROR_BALL"])
def test_mapping_and_size_of_an_image_are_as_in_cycles(vector_type, size, projection):
    empty_cycles_scene(samples=256)
    (width, height), image = size, bpy.data.images.new("Waves", *size, float_buffer=True)
    x, y = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    pixels = np.stack([1 + np.cos(2 * np.pi * x), 1 + np.sin(2 * np.pi * x), 3 * y, np.ones_like(x)], axis=-1)
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    made, texture = image_world(image, rotation=(0.4, -0.7, 1.1))
    texture.projection, mapping = projection, made.node_tree.nodes["Mapping"]
    mapping.vector_type, mapping.inputs["Scale"].default_value = vector_type, (1.0, 0.6, 1.7)
    if vector_type in ("POINT", "TEXTURE"):
        mapping.inputs["Location"].default_value = 0.1, -0.2, 0.3
    environment = convert_world(copied(made), Report())
    for normal in ((0, 0, 1), (-1, 0.4, 0.2)):
        np.testing.assert_allclose(gathered(environment, normal), irradiance((0, 0, 0), normal), rtol=0.02)


def test_gradient_over_height_and_camera_branch():
    empty_cycles_scene(samples=512)
    made, tree, background = world()
    names = ("TexCoord", "SeparateXYZ", "ValToRGB", "LightPath", "MixShader", "Background")
    coordinate, separate, ramp, path, mix, other = (tree.nodes.new("ShaderNode" + n) for n in names)
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (1, 0.2, 0.1, 1), (0.1, 0.3, 1, 1)
    other.inputs["Color"].default_value = (0, 50, 0, 1)
    for start, end in ((coordinate.outputs["Generated"], separate.inputs[0]), (separate.outputs["Z"], ramp.inputs[0]),
                       (ramp.outputs[0], background.inputs["Color"]), (path.outputs["Is Camera Ray"], mix.inputs[0]),
                       (background.outputs[0], mix.inputs[1]), (other.outputs[0], mix.inputs[2]),
                       (mix.outputs[0], next(n for n in tree.nodes if n.type == "OUTPUT_WORLD").inputs[0])):
        tree.links.new(start, end)
    environment = convert_world(copied(made), Report())
    for normal in ((0, 0, 1), (1, 0, 0.1)):
        np.testing.assert_allclose(gathered(environment, normal), irradiance((0, 0, 0), normal), rtol=0.02)


def test_black_or_absent_worlds_are_none_and_missing_images_magenta():
    empty_cycles_scene()
    made, _, background = world()
    assert convert_world_light(None, None, Report()).environment is None
    background.inputs["Strength"].default_value = 0
    assert convert_world_light(copied(made), None, Report()).environment is None
    report = Report()
    image = bpy.data.images.new("Gone", 4, 4)
    image.source, image.filepath = "FILE", "//nowhere/gone.exr"
    made, _ = image_world(image)
    np.testing.assert_allclose(convert_world(copied(made), report)[5, 5], (1, 0, 1))
    assert "gone.exr" in report.lines()[0] and made.name in report.lines()[0]


def test_object_coordinates_of_the_world_are_as_in_cycles():
    empty_cycles_scene(samples=512)
    made, tree, background = world()
    pivot = bpy.data.objects.new("Pivot", None)
    bpy.context.scene.collection.objects.link(pivot)
    pivot.matrix_world = Matrix.LocRotScale((0.2, 0.1, -0.3), Euler((0.9, 0.3, 0.4)), (1, 2, 1.5))
    coordinate, positive = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeVectorMath")
    coordinate.object, positive.operation = pivot, "ABSOLUTE"
    tree.links.new(coordinate.outputs["Object"], positive.inputs[0])
    tree.links.new(positive.outputs[0], background.inputs["Color"])
    bpy.context.view_layer.update()
    environment = convert_world(copied(made), Report())
    for normal in ((0, 0, 1), (1, 0, 0.1), (0, -1, 0)):
        expected = irradiance((0, 0, 0), normal)
        np.testing.assert_allclose(gathered(environment, normal), expected, rtol=0.03, atol=0.02)
