# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances of one mesh look different where their material asks where they stand, and share their tiles where not."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR, ROUGHNESS


@pytest.fixture
def pair(add_mesh, add_material):
    """Two objects of one mesh and one material."""
    made = add_material("Look")
    first = add_mesh("First", materials=[made])
    second = bpy.data.objects.new("Second", first.data)
    bpy.context.scene.collection.objects.link(second)
    second.location, second.color = (3, 0, 0), (0.1, 0.2, 0.3, 1)
    first.pass_index, second.pass_index = 1, 4
    return first, second, made.node_tree


def linked(tree, kind, output, entry="Base Color"):
    node = tree.nodes.new(kind)
    tree.links.new(node.outputs[output], tree.nodes["Principled BSDF"].inputs[entry])
    return node


def test_object_colours_differ(pair, converted, report):
    linked(pair[2], "ShaderNodeObjectInfo", "Color")
    scene = converted()
    first, second = scene.tiles[scene.tile_index, BASE_COLOR][..., 0, 0].astype(np.float32)
    np.testing.assert_allclose(first, 1)
    np.testing.assert_allclose(second, (0.1, 0.2, 0.3), atol=1e-3)
    assert not report.entries


def test_world_coordinates_differ(pair, converted, report):
    linked(pair[2], "ShaderNodeNewGeometry", "Position", "Roughness")
    scene = converted()
    assert len(scene.tiles) == 2 and not report.entries
    rough = scene.tiles[scene.tile_index, ROUGHNESS].astype(np.float32)
    assert rough[1].min() == 1 and rough[0].max() < 1


@pytest.mark.parametrize("output", ["Generated", "Object"])
def test_coordinates_of_the_mesh_are_shared(pair, converted, output):
    linked(pair[2], "ShaderNodeTexCoord", output)
    scene = converted()
    assert len(scene.tiles) == 1 and (scene.tile_index == 0).all()


def test_only_the_instance_that_shines_is_an_emitter(pair, converted):
    tree = pair[2]
    index, more = linked(tree, "ShaderNodeObjectInfo", "Object Index", "Roughness"), tree.nodes.new("ShaderNodeMath")
    more.operation, more.inputs[1].default_value = "GREATER_THAN", 2
    tree.links.new(index.outputs["Object Index"], more.inputs[0])
    tree.links.new(more.outputs[0], tree.nodes["Principled BSDF"].inputs["Emission Strength"])
    scene = converted()
    shines = scene.emission.max(axis=-1).reshape(2, -1).max(axis=1) > 0
    assert (scene.triangles[shines, :, 0] >= 3).all() and shines.sum() == 1


def test_custom_properties_of_objects(pair, converted):
    first, second, tree = pair
    first["wear"], second["wear"] = 0.25, 0.75
    node = linked(tree, "ShaderNodeAttribute", "Fac", "Roughness")
    node.attribute_type, node.attribute_name = "OBJECT", "wear"
    scene = converted()
    np.testing.assert_allclose(scene.tiles[scene.tile_index, ROUGHNESS, 0, 0], (0.25, 0.75))
