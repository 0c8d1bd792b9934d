# SPDX-License-Identifier: GPL-3.0-or-later
"""Where Max Triangles goes, for the camera at (0, -5, 0) that looks along +Y."""
from itertools import pairwise

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.meshes import read_mesh
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data import mesh as meshes
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.meshes import reduce


def ball(location, segments=64):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=segments, ring_count=segments // 2, location=location)
    return bpy.context.object


def count(scene, low, high) -> int:
    """Triangles whose middle has y between low and high."""
    y = scene.triangles.mean(axis=1)[:, 1]
    return np.count_nonzero((y > low) & (y < high))


def test_what_looks_large_gets_more_than_what_is_far_or_unseen(converted):
    for y in (0, 40, -15):  # near, far, behind the camera
        ball((0, y, 0 if y else 0.3))
    bpy.ops.mesh.primitive_plane_add(size=30, location=(0, 10, -3))
    scene = converted(token_budget=1500, seen=True)
    near, far, behind = count(scene, -2, 2), count(scene, 35, 45), count(scene, -20, -10)
    assert len(scene) <= 1500 and near > 3 * far and near > 3 * behind
    assert min(far, behind) >= 8  # they still throw light and shadow


def test_what_is_hidden_makes_room_for_what_is_seen(converted):
    ball((0, 0, 0)), ball((-0.5, 4, 0)), ball((0.5, 40, 0))
    bpy.ops.mesh.primitive_plane_add(size=60, location=(0, 8, 0), rotation=(np.pi / 2, 0, 0))
    scene = converted(token_budget=1500, seen=True)
    assert count(scene, 35, 45) < 0.25 * count(scene, -2, 7.5)


def test_a_mirrored_camera_allots_alike(converted, scene):
    for place in ((0, 0, 0), (0, 4, 0), (0, 40, 0), (0, -40, 0)):
        ball(place)
    counts = []
    for scene.camera.scale.x in (1, -1):
        found = converted(token_budget=1500, seen=True)
        counts.append([count(found, *where) for where in ((-2, 2), (2, 6), (35, 45), (-45, -35))])
    np.testing.assert_allclose(*counts, rtol=0.1)


def test_what_stands_still_keeps_its_triangles_while_something_enters_the_picture(converted):
    ball((0.5, 0, 0), 40), ball((1, 5, 0), 40)
    entering, shot, pictures = ball((-6, 0, 0), 40), [], []

    def steady(framing):
        shot.append(framing)
        return shot[0]
    for x in np.linspace(-4, -1.7, 6):
        entering.location.x = x
        scene = converted(token_budget=1500, seen=True, choose_framing=steady)
        assert 1000 < len(scene) <= 1500
        still = scene.triangles[scene.triangles[..., 0].min(axis=1) > -0.6]
        pictures.append({triangle.tobytes() for triangle in still})
    changed = [len(after - before) > 0.1 * len(after) for before, after in pairwise(pictures)]
    assert sum(changed) <= 2 and shot[0].shares


def test_near_instances_are_finer_than_far_ones(converted):
    source = ball((0, 0, 0))
    for i in range(1, 12):
        copy = bpy.data.objects.new(f"copy{i}", source.data)
        copy.location = (i % 3 - 1, 8 * i, 0)
        bpy.context.scene.collection.objects.link(copy)
    scene = converted(token_budget=1200, seen=True)
    assert count(scene, -2, 2) > 4 * count(scene, 85, 91) >= 32


@pytest.mark.parametrize("seen", [False, True])
def test_instanced_leaves_for_which_there_is_no_room_are_stood_for_by_larger_ones(converted, add_mesh, report, seen):
    places = np.random.default_rng(0).uniform(-1, 1, (4000, 3))
    crown = add_mesh("Crown", places, ())
    leaf = add_mesh("Leaf", ((-0.01, 0, -0.01), (0.01, 0, -0.01), (0.01, 0, 0.01), (-0.01, 0, 0.01)), [(0, 1, 2, 3)])
    leaf.parent, crown.instance_type = crown, "VERTS"
    scene = converted(token_budget=1000, seen=seen)
    assert 800 < len(scene) <= 1000
    assert meshes.areas(scene.triangles).sum() == pytest.approx(4000 * 0.02 ** 2, rel=0.1)
    assert np.abs(np.median(scene.triangles.mean(axis=1), axis=0)).max() < 0.3  # near ones are kept rather
    assert [(kind, name) for kind, name, *_ in report.entries] == [("approximated", "Leaf")]
    assert "enlarged" in report.entries[0][2]


def test_a_large_mesh_is_finer_near_the_camera(converted):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=100, y_subdivisions=100, size=40, location=(0, 10, -1))
    mesh = bpy.context.object.data
    place = np.array([v.co for v in mesh.vertices])
    place[:, 2] = 0.3 * np.sin(2 * place[:, 0]) * np.sin(2 * place[:, 1])
    mesh.vertices.foreach_set("co", place.ravel())
    scene = converted(token_budget=1000, seen=True)
    assert count(scene, -5, 5) > 1.5 * count(scene, 20, 30)
    np.testing.assert_allclose(np.ptp(scene.triangles, axis=(0, 1))[:2], 40, atol=0.5)


def test_textures_are_divided_further_and_only_where_they_are_seen(converted, add_material):
    plain, textured = add_material("plain"), add_material("textured")
    tree = textured.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeTexChecker").outputs["Color"],
                   tree.nodes["Principled BSDF"].inputs["Base Color"])
    for location, material in (((-1.2, 0, 0), plain), ((1.2, 0, 0), textured), ((0, -9, 0), textured)):
        bpy.ops.mesh.primitive_plane_add(size=2, location=location, rotation=(np.pi / 2, 0, 0))
        bpy.context.object.data.materials.append(material)
    scene = converted(max_edge=0.4, seen=True)
    x, y, _ = scene.triangles.mean(axis=1).T
    left, right, behind = (np.count_nonzero(which) for which in ((x < 0) & (y > -5), (x > 0) & (y > -5), y < -5))
    assert right > 4 * left and right > 4 * behind


def test_uv_seams_stay_where_they_are(report):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=60, y_subdivisions=60)
    mesh = read_mesh(bpy.context.object.data, "grid", report)
    mesh.uv["UVMap"] += np.where(mesh.corners.mean(axis=1)[:, :1] > 0, 0.3, 0)[:, None]
    small = reduce.simplify(mesh, 300)
    x = small.corners[..., 0]
    assert not np.any((x.min(axis=1) < -1e-3) & (x.max(axis=1) > 1e-3)) and len(small) <= 300


@pytest.mark.slow
def test_slivers_do_not_cost_the_rest_of_the_shape(report):
    bumpy = ball((0, 0, 0), segments=256).modifiers.new("bumpy", "DISPLACE")
    bumpy.texture, bumpy.strength = bpy.data.textures.new("clouds", "CLOUDS"), 0.3
    bpy.ops.object.modifier_apply(modifier="bumpy")
    mesh = read_mesh(bpy.context.object.data, "ball", report)
    small = reduce.simplify(mesh, 1000)
    areas = meshes.areas(small.corners)
    np.testing.assert_allclose(areas.sum(), meshes.areas(mesh.corners).sum(), rtol=0.1)
    assert areas.max() < 30 * np.median(areas)


@pytest.mark.parametrize("smooth", [True, False])
def test_rays_meet_curved_faces_whole_that_are_divided_into_tokens(converted, smooth):
    bpy.ops.mesh.primitive_cylinder_add(vertices=8, depth=4)
    bpy.context.object.data.polygons.foreach_set("use_smooth", [smooth] * 10)
    scene = converted(max_edge=0.1)
    assert len(scene) > 200
    assert len(scene.surfaces.triangles) == (28 if smooth else len(scene))
    assert len(np.unique(scene.surfaces.token)) == len(scene.surfaces.triangles)


def test_pieces_of_a_simplified_mesh_shine_as_much_as_what_they_stand_for(converted, add_material):
    """Simplifying takes area from thin pieces, such as letters, and not from thick ones beside them."""
    thick = ball((-1.5, 0, 0))
    bpy.ops.mesh.primitive_torus_add(location=(1.5, 0, 0), minor_radius=0.05, major_segments=96, minor_segments=24)
    thick.select_set(True)
    bpy.context.view_layer.objects.active = thick
    bpy.ops.object.join()
    thick.data.materials.append(add_material("Glowing", (0, 0, 0), emission=20.0))
    real = {side: meshes.areas(whole.triangles)[side * whole.triangles[:, 0, 0] > 0].sum()
            for whole in [converted()] for side in (-1, 1)}
    scene = converted(token_budget=300)
    assert len(scene) <= 300
    power = scene.emission[:, 0] * meshes.areas(scene.triangles)
    for side, area in real.items():
        assert power[side * scene.triangles[:, 0, 0] > 0].sum() == pytest.approx(20 * area, rel=0.03)
