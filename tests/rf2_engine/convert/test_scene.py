# SPDX-License-Identifier: GPL-3.0-or-later
"""The walk over a depsgraph: every kind of object, instances, visibility, cancel."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model import progress, rays
from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.mesh import areas
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import wheels


def test_empty_scene_is_valid(converted):
    scene = converted()
    assert len(scene) == 0 and scene.volumes is None
    np.testing.assert_allclose(scene.environment, 0.25, rtol=1e-5)


@pytest.mark.parametrize("is_made", [True, False])
def test_embree_is_to_be_installed_only_where_it_is_made(converted, report, monkeypatch, is_made):
    monkeypatch.setattr(rays, "has_embree", lambda: False)
    monkeypatch.setattr(wheels, "is_made", lambda distribution: is_made)
    converted()
    said, = (line for line in report.lines() if "embreex is missing" in line)
    assert ("Install Packages" in said) == is_made


def test_text_curve_surface_and_metaball_are_rendered_once(converted, report):
    bpy.ops.object.text_add(location=(0, 0, 0))
    bpy.ops.curve.primitive_bezier_circle_add(location=(10, 0, 0))
    bpy.context.object.data.bevel_depth = 0.1
    bpy.ops.object.metaball_add(location=(20, 0, 0))
    bpy.ops.surface.primitive_nurbs_surface_sphere_add(location=(30, 0, 0))
    scene = converted()
    place = np.round(scene.triangles.mean(axis=(1)) / 10)[:, 0]
    assert set(place) == {0, 1, 2, 3}
    assert len(np.unique(np.round(scene.triangles, 4), axis=0)) > 0.99 * len(scene)
    assert not [entry for entry in report.entries if entry[0] == "skipped"]


def test_collection_instances_stand_where_their_empties_are(scene, converted, add_mesh):
    obj = add_mesh("part")
    collection = bpy.data.collections.new("parts")
    collection.objects.link(obj)
    scene.collection.objects.unlink(obj)
    for i in range(3):
        empty = bpy.data.objects.new(f"empty{i}", None)
        empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", collection, (0, 0, i)
        scene.collection.objects.link(empty)
    result = converted()
    assert sorted(result.triangles[:, 0, 2]) == [0, 1, 2]
    assert len(result.tiles) == 1


def test_geometry_nodes_instances(converted, add_mesh):
    tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    line, cube, place = (tree.nodes.new(f"GeometryNode{n}") for n in ("MeshLine", "MeshCube", "InstanceOnPoints"))
    line.inputs["Count"].default_value = 4
    line.inputs["Offset"].default_value = (0, 0, 3)
    tree.links.new(line.outputs["Mesh"], place.inputs["Points"])
    tree.links.new(cube.outputs["Mesh"], place.inputs["Instance"])
    tree.links.new(place.outputs["Instances"], tree.nodes.new("NodeGroupOutput").inputs[0])
    add_mesh("host").modifiers.new("nodes", "NODES").node_group = tree
    scene = converted()
    assert len(scene) == 4 * 12
    assert sorted(set(np.round(scene.triangles.mean(axis=1)[:, 2] / 3))) == [0, 1, 2, 3]


def test_visibility_and_unsupported_kinds(converted, add_mesh, report):
    add_mesh("off_camera").visible_camera = False
    hidden = add_mesh("nowhere")
    for ray in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(hidden, f"visible_{ray}", False)
    add_mesh("disabled").hide_viewport = True
    bpy.ops.object.grease_pencil_add(type="MONKEY")
    name = bpy.context.object.name
    assert len(converted()) == 1
    (remark,) = [remark for remark in report.entries if remark.name == name]
    assert remark.kind == "approximated" and "drawn over the picture" in remark.message


def test_lamps_and_surfaces_share_one_budget(converted):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=64)
    bpy.ops.object.light_add(type="POINT", location=(0, 0, 5))
    scene = converted(token_budget=500)
    assert 400 < len(scene) <= 500 and np.count_nonzero(scene.is_light) > 0


def test_many_lamps_leave_half_of_the_budget(converted, report):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=64)
    for i in range(40):
        bpy.ops.object.light_add(type="SPOT", location=(i - 20, 0, 5))
        bpy.context.object.data.energy = i + 1
    light = []
    for budget, merged in ((1600, False), (400, True)):
        scene = converted(token_budget=budget)
        assert len(scene) <= budget and np.count_nonzero(~scene.is_light) > budget / 2
        light.append(areas(scene.triangles) @ scene.emission)
        assert any(name == "Lamps" and "replace 40" in message for _, name, message in report.entries) == merged
    np.testing.assert_allclose(light[0], light[1], rtol=1e-3)


def test_progress_names_the_object_count_and_can_cancel(converted, add_mesh):
    for i in range(3):
        add_mesh(f"m{i}")
    calls = []
    with progress.reporting(lambda text, fraction: calls.append((text, fraction))):
        converted()
    assert any(text.startswith("Reading objects, 2 of") for text, _ in calls)
    fractions = [fraction for _, fraction in calls]
    assert fractions == sorted(fractions) and 0 <= fractions[0] and fractions[-1] <= 1

    def cancel(text, fraction):
        raise RenderCancelled
    with pytest.raises(RenderCancelled), progress.reporting(cancel):
        converted()


def test_clear_triangles_are_left_out_by_name(converted, add_mesh, add_material, report):
    glass = add_material("Clear")
    glass.node_tree.nodes["Principled BSDF"].inputs["Alpha"].default_value = 0
    add_mesh("Decal", materials=[glass])
    add_mesh("Wall")
    assert len(converted()) == 1
    assert any(name == "Decal" and "transparent" in message for _, name, message in report.entries)


def test_a_working_space_other_than_rec709_is_reported(converted, report):
    def told():
        return any(name == "Working Space" for _, name, _ in report.entries)

    converted()
    assert not told()
    if hasattr(bpy.data, "colorspace"):  # Blender 5
        bpy.ops.wm.set_working_color_space(working_space="ACEScg")
        converted()
        assert told()


def test_surfaces_that_shine_faintly_beside_a_lamp_only_glow_and_reflect_as_others(converted, add_mesh, add_material):
    material = add_material("wall", color=(0.8, 0.1, 0.1), emission=0.1)
    add_mesh("wall", materials=[material])
    bpy.context.scene.world = None
    assert converted().is_light.all()  # there is no other light
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT"))
    bpy.context.scene.collection.objects.link(lamp)
    scene = converted()
    np.testing.assert_allclose(scene.glow[:, 0], np.where(scene.is_light, 0, 0.1), rtol=1e-3)
    assert scene.tiles[scene.tile_index[~scene.is_light]][0, 0].mean() == pytest.approx(0.8, abs=1e-3)
    material.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 5
    assert converted().is_light.all()
