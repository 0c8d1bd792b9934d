# SPDX-License-Identifier: GPL-3.0-or-later
"""A volume that fills the world, against Cycles: how far one sees in it, and what light comes through."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.scene import convert
from mathutils import Matrix

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, irradiance, lamp, material, pictured, world
from tests.rf2_engine.convert.media.test_optical_depth import background_left
from tests.rf2_engine.convert.token_light import gathered, integrated

HEIGHT = 1.4  # of the camera, metres


def foggy(color=(0.2, 0.5, 0.9, 1)):
    """(node tree, Background node) of a world that absorbs."""
    made, tree, background = world()
    fog = tree.nodes.new("ShaderNodeVolumeAbsorption")
    fog.inputs["Density"].default_value, fog.inputs["Color"].default_value = 0.8, color
    tree.links.new(fog.outputs[0], next(n for n in tree.nodes if n.type == "OUTPUT_WORLD").inputs["Volume"])
    return made, tree, background


def looked_at(report):
    """The scene as a camera above the origin sees it."""
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye"))
    scene.camera.location = 0, 0, HEIGHT
    scene.collection.objects.link(scene.camera)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return convert(depsgraph, convert_camera(depsgraph, 64, 64, None), ConversionOptions(4096, 1), report)


@pytest.mark.parametrize("varied", [False, True])
def test_one_sees_as_far_as_in_cycles(report, varied):
    scene = empty_cycles_scene()
    if hasattr(scene.cycles, "volume_biased"):  # quicker, and as it was before Blender 5
        scene.cycles.volume_biased = True
    made, tree, background = foggy()
    background.inputs["Strength"].default_value = 0
    if varied:
        noise = tree.nodes.new("ShaderNodeTexNoise")
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Object"], noise.inputs["Vector"])
        tree.links.new(noise.outputs[0], tree.nodes["Volume Absorption"].inputs["Density"])
        noise.inputs["Scale"].default_value = 1.5
    shining = material("ShaderNodeEmission", Strength=1.0)[0]
    bpy.ops.mesh.primitive_grid_add(size=4)
    bpy.context.object.data.materials.append(shining)
    expected = pictured(HEIGHT, HEIGHT, resolution=8).mean(axis=(0, 1))
    found = background_left(looked_at(report).volumes, from_height=HEIGHT, side=HEIGHT).mean(axis=(0, 1))
    np.testing.assert_allclose(np.log(found), np.log(expected), rtol=0.05)
    assert any(name == made.name and "its volume fills" in message for _, name, message in report.entries)


def test_light_from_beyond_comes_through_where_it_does_in_cycles(report):
    empty_cycles_scene()
    foggy(color=(0, 1, 0.5, 1))
    lamp("SUN", Matrix(), energy=3)
    expected = irradiance((0, 0, 0), (0, 0, 1))
    assert expected[1] > 1 and not expected[[0, 2]].any()
    scene = looked_at(report)
    found = integrated(scene, (0, 0, 0), (0, 0, 1)) + gathered(scene.environment, (0, 0, 1))
    np.testing.assert_allclose(found, expected, rtol=0.02, atol=1e-4)


def test_it_is_where_the_view_looks_past_the_ground_and_around_lamps_nearby(report):
    empty_cycles_scene()
    foggy()
    bpy.ops.mesh.primitive_grid_add(size=8)
    lamp("POINT", Matrix.Translation((0, 0, 4)))
    lamp("POINT", Matrix.Translation((0, 0, 400)))
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye"))
    scene.camera.location, scene.camera.rotation_euler = (0, -4, 1), (np.pi / 2, 0, 0)
    scene.camera.data.lens = 36  # half as wide as far
    scene.collection.objects.link(scene.camera)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    volumes = convert(depsgraph, convert_camera(depsgraph, 64, 64, None), ConversionOptions(4096, 1), report).volumes
    low, high = (end(volumes.position.reshape(-1, 3), axis=0) for end in (np.min, np.max))
    assert 3.5 < high[2] < 4.5 and high[0] > 1.5 and low[2] > -2.5
