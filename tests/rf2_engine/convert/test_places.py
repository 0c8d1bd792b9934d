# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances of one mesh look different where their material asks where they stand, and share their tiles where not."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR, ROUGHNESS

from tests.rf2_engine.convert.cycles_reference import material, rendered


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


def test_instances_of_geometry_nodes_have_attributes_of_their_own(scene, add_mesh, converted, report):
    made, tree, shader = material("ShaderNodeEmission", "Told", Strength=1.0)
    asked = tree.nodes.new("ShaderNodeAttribute")
    asked.attribute_type, asked.attribute_name = "INSTANCER", "tint"
    tree.links.new(asked.outputs["Color"], shader.inputs["Color"])
    leaf = add_mesh("Leaf", materials=[made])
    group = bpy.data.node_groups.new("Grow", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    end, points, grown, stored, one, at = (group.nodes.new(kind) for kind in (
        "NodeGroupOutput", "GeometryNodeMeshLine", "GeometryNodeInstanceOnPoints", "GeometryNodeStoreNamedAttribute",
        "GeometryNodeObjectInfo", "GeometryNodeInputPosition"))
    stored.data_type, stored.domain = "FLOAT_VECTOR", "INSTANCE"
    points.inputs["Offset"].default_value, one.inputs["Object"].default_value = (1.5, 1, 0.5), leaf
    stored.inputs["Name"].default_value = "tint"
    for source, entry in ((points.outputs[0], grown.inputs["Points"]), (grown.outputs[0], stored.inputs[0]),
                          (one.outputs["Geometry"], grown.inputs["Instance"]), (stored.outputs[0], end.inputs[0]),
                          (at.outputs[0], next(s for s in stored.inputs if s.name == "Value" and s.enabled))):
        group.links.new(source, entry)
    field = add_mesh("Field")
    field.location = (5, 6, 7)
    field.modifiers.new("Grow", "NODES").node_group = group
    leaf.hide_render = True
    bpy.context.view_layer.update()
    scene = converted()
    shining = scene.emission.any(axis=1)
    at = scene.triangles.min(axis=1)[shining] - (5, 6, 7)
    assert shining.sum() == 9  # the first tint is black
    np.testing.assert_allclose(scene.emission[shining], at, atol=1e-3)


@pytest.mark.parametrize("kind, output", [
    ("ObjectInfo", "Random"), ("TexCoord", "Generated"), ("TexCoord", "UV"), ("ParticleInfo", "Size"),
    ("ParticleInfo", "Location")])
def test_instances_are_told_apart_as_in_cycles(scene, add_mesh, converted, kind, output):
    made, tree, emission = material("ShaderNodeEmission", "Told", Strength=1.0)
    made.cycles.emission_sampling = "NONE"
    node = tree.nodes.new("ShaderNode" + kind)
    if kind == "TexCoord":
        node.from_instancer = True
    away = tree.nodes.new("ShaderNodeVectorMath")  # so that every instance shines
    away.inputs[1].default_value = (2, 2, 2)
    tree.links.new(node.outputs[output], away.inputs[0])
    tree.links.new(away.outputs[0], emission.inputs["Color"])
    tips = 0.3 * np.concatenate([np.eye(3), -np.eye(3)])
    leaf = add_mesh("Leaf", tips, [(a, b, c) for a in (0, 3) for b in (1, 4) for c in (2, 5)], [made])
    corners = np.array([(x, y, 0) for y in (-1.5, -0.5, 0.5, 1.5) for x in (-1.5, -0.5, 0.5, 1.5)])
    tree = add_mesh("Tree", corners, [(i, i + 1, i + 5, i + 4) for i in (0, 1, 2, 4, 5, 6, 8, 9, 10)])
    tree.data.uv_layers.new(name="UVMap").data.foreach_set("uv", np.random.default_rng(0).random(72))
    if kind == "ParticleInfo":
        grown = tree.modifiers.new("Leaves", "PARTICLE_SYSTEM").particle_system.settings
        grown.count, grown.frame_end, grown.lifetime, grown.size_random = 5, 1, 100, 0.5
        grown.physics_type, grown.render_type, grown.instance_object = "NO", "OBJECT", leaf
        grown.particle_size = 0.6
    else:
        leaf.parent, tree.instance_type = tree, "FACES"
    tree.show_instancer_for_render = False
    scene.camera.location, scene.camera.rotation_euler, scene.camera.data.type = (0, 0, 5), (0, 0, 0), "ORTHO"
    scene.camera.data.ortho_scale, scene.render.engine = 4, "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    scene.render.image_settings.file_format = "OPEN_EXR"
    found = converted()
    picture = rendered(scene)
    middle = found.triangles.mean(axis=1)[:, :2]
    instances = found.emission.any(axis=1) & (np.abs(middle).max(axis=1) > 0.4)  # the leaf itself lies in the middle
    pixel = ((middle[instances] + 2) * 16).astype(int)
    shown = picture[pixel[:, 1], pixel[:, 0]]
    assert len(shown) > 16 and (output == "Generated" or np.ptp(shown, axis=0).max() > 0.1)  # faces give no Generated
    np.testing.assert_allclose(found.emission[instances], shown, atol=0.02)
