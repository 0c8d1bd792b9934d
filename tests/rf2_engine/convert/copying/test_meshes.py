# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles, normals and materials of evaluated meshes."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.meshes import read_mesh
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data import mesh as meshes


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-2, -0.5, -1), (3, 0.2, 1)])
def test_sphere_faces_outwards_under_any_scale(converted, scale):
    bpy.ops.mesh.primitive_uv_sphere_add(location=(1, 2, 3), rotation=(0.3, 0.2, 0.1))
    bpy.ops.object.shade_smooth()
    bpy.context.object.scale = scale
    scene = converted()
    outwards = scene.triangles.mean(axis=1) - (1, 2, 3)
    assert ((outwards * meshes.face_normals(scene.triangles)).sum(axis=1) > 0).all()
    rotation = np.array(bpy.context.object.rotation_euler.to_matrix())
    local = (scene.triangles - np.float32((1, 2, 3))) @ rotation
    expected = meshes.unit_or(local / np.square(scale), np.zeros(3)) @ rotation.T  # gradient of the ellipsoid
    assert (np.linalg.norm(scene.normals, axis=2) == pytest.approx(1, abs=1e-5))
    assert np.arccos(np.clip((expected * scene.normals).sum(axis=2), -1, 1)).max() < 0.1


def test_mirrored_mesh_keeps_uv_at_its_corners(add_mesh, report):
    obj = add_mesh("triangle")
    layer = obj.data.uv_layers.new(name="flat")
    layer.uv.foreach_set("vector", [0, 0, 1, 0, 0, 1])
    mesh = read_mesh(obj.data, "triangle", report).mirrored()
    assert mesh.active_uv == "flat"
    np.testing.assert_array_equal(mesh.uv["flat"], mesh.corners[..., :2])


def test_material_slots_of_mesh_and_object(converted, add_mesh, add_material):
    red, green, blue = (add_material(n, c) for n, c in zip("rgb", np.eye(3), strict=True))
    obj = add_mesh("two", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (5, 0, 0), (6, 0, 0), (5, 1, 0)], [(0, 1, 2), (3, 4, 5)],
                   [red, green])
    obj.data.polygons[1].material_index = 1
    obj.material_slots[1].link = "OBJECT"
    obj.material_slots[1].material = blue
    scene = converted()
    right = scene.triangles[:, :, 0].min(axis=1) > 4
    colors = scene.tiles[scene.tile_index][:, BASE_COLOR, 0, 0]
    np.testing.assert_array_equal(colors[right], [[0, 0, 1]])
    np.testing.assert_array_equal(colors[~right], [[1, 0, 0]])


def test_broken_triangles_are_dropped_by_name(converted, add_mesh, report):
    nan = float("nan")
    add_mesh("broken", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (nan, 0, 0), (2, 0, 0)], [(0, 1, 2), (0, 1, 3), (0, 1, 4)])
    assert len(converted()) == 1
    messages = [message for kind, name, message in report.entries if (kind, name) == ("refused", "broken")]
    assert any("infinite" in m for m in messages) and any("area" in m for m in messages)


def test_triangles_in_the_same_place_are_dropped_and_counted(converted, add_mesh, report):
    add_mesh("double", faces=[(0, 1, 2), (1, 2, 0), (2, 1, 0)])
    assert len(converted()) == 1
    assert any(name == "double" and "2 triangles" in message for _, name, message in report.entries)


@pytest.mark.parametrize("size", [0.5, 1, 2, 3, 4, 8])
def test_the_halves_of_a_square_are_two_triangles(converted, report, size):
    for turned in ((0, 0, 0), (np.pi / 2, 0, 0), (0, np.pi / 2, 0)):
        bpy.ops.mesh.primitive_plane_add(size=size, location=(10 * size, 0, 0), rotation=turned)
    assert len(converted()) == 6 and not report.entries


def test_no_two_points_of_round_coordinates_are_taken_for_one():
    side = np.float32([-8, -4, -2, -1, -0.5, 0, 0.25, 0.5, 1, 1.5, 2, 3, 4, 8])
    points = np.stack(np.meshgrid(side, side, side), -1).reshape(-1, 3)
    keys = meshes.corner_keys(np.repeat(points[:, None], 3, axis=1))[:, 0]
    assert len(np.unique(keys)) == len(points)
    assert len(np.unique((keys[:300, None] + keys[None, :300])[np.triu_indices(300)])) == 300 * 301 // 2


def test_meshes_without_triangles_and_huge_ones_are_survived(converted, add_mesh):
    nan = float("nan")
    add_mesh("points", faces=[])
    add_mesh("nothing left", [(nan, nan, nan)] * 3)
    loose = bpy.data.meshes.new("loose")
    loose.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("loose", loose))
    add_mesh("huge", [(0, 0, 0), (1e12, 0, 0), (0, 1e12, 0)])
    scene = converted(seen=True)
    assert np.isfinite(scene.triangles).all() and meshes.areas(scene.triangles).sum() == pytest.approx(5e23)


def test_smooth_faces_beside_flat_ones_are_shaded_as_in_cycles(report):
    """Before 5.2 smooth shading goes on past the border of flat faces there, unless some edges are sharp."""
    bpy.ops.mesh.primitive_cylinder_add(vertices=16)
    data = bpy.context.object.data
    is_side = [len(polygon.vertices) == 4 for polygon in data.polygons]
    data.polygons.foreach_set("use_smooth", is_side)
    flat, leaning = (np.abs(x) for x in _heights_of_normals(data, report))
    assert flat == pytest.approx(1) and (leaning > 0.6).all() == (bpy.app.version < (5, 2))
    data.edges.foreach_set("use_edge_sharp", [True] * len(data.edges))
    assert np.abs(_heights_of_normals(data, report)[1]).max() < 1e-5


def _heights_of_normals(data, report) -> tuple[np.ndarray, np.ndarray]:
    """Z of the normals at corners of faces across Z, and along it."""
    mesh = read_mesh(data, "cylinder", report)
    is_cap = np.abs(meshes.face_normals(mesh.corners)[:, 2]) > 0.5
    return mesh.normals[is_cap][..., 2], mesh.normals[~is_cap][..., 2]
