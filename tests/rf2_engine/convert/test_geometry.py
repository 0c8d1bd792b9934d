# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays meet the meshes as they are, and each of their triangles has the token that stands for it."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.geometry import area_vectors
from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data import mesh as meshes
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.fitting import real_surfaces

FACES = 20 * 4 ** 4  # of the ball below


def ball(name="Ball", location=(0, 0, 0), of=None):
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=5, location=location)
    added = bpy.context.object
    added.name = name
    added.data.materials.append(of)
    return added


def base_colors(scene) -> np.ndarray:
    """(G, 3) of the token of each triangle."""
    colors = scene.tiles[:, BASE_COLOR].mean(axis=(2, 3), dtype=np.float32)
    return colors[scene.tile_index[scene.geometry.token]]


def test_a_simplified_mesh_keeps_its_real_surface_beside_its_tokens(converted):
    ball()
    scene = converted(token_budget=300)
    assert len(scene) <= 300 and len(scene.geometry) == FACES
    np.testing.assert_allclose(np.linalg.norm(scene.geometry.triangles, axis=-1), 1, atol=1e-5)
    away = scene.geometry.triangles.mean(axis=1) - scene.triangles[scene.geometry.token].mean(axis=1)
    assert np.linalg.norm(away, axis=1).max() < 0.4
    facing = meshes.face_normals(scene.triangles)[scene.geometry.token]
    assert (facing * meshes.face_normals(scene.geometry.triangles)).sum(axis=1).min() > 0.5


def test_what_is_not_simplified_is_geometry_itself(converted):
    ball()
    assert converted().geometry is None


def test_the_whole_mesh_counts_after_modifiers_and_shape_keys(converted):
    moved = ball()
    moved.shape_key_add(name="Basis")
    up = moved.shape_key_add(name="Up")
    for point in up.data:
        point.co.z += 3
    up.value = 1.0
    moved.modifiers.new("Twice", "ARRAY").count = 2
    scene = converted(token_budget=300)
    assert len(scene.geometry) == 2 * FACES and scene.geometry.triangles[..., 2].min() == pytest.approx(2, abs=1e-3)


def test_triangles_get_tokens_of_their_own_material(converted, add_material):
    two = ball(of=add_material("Red", (0.8, 0.1, 0.1)))
    two.data.materials.append(add_material("Blue", (0.1, 0.1, 0.8)))
    for face in two.data.polygons:
        face.material_index = int(face.center.z > 0)
    scene = converted(token_budget=200)
    is_blue = base_colors(scene)[:, 2] > 0.5
    np.testing.assert_array_equal(is_blue, scene.geometry.triangles.mean(axis=1)[:, 2] > 0)


def test_instances_without_room_for_tokens_stay_in_the_way_of_rays(converted, add_material, report):
    """A forest of more trees than tokens: each casts its shadow."""
    source = ball(of=add_material("Leaf", (0.1, 0.6, 0.1)))
    for i in range(1, 100):
        copy = bpy.data.objects.new(f"Ball {i}", source.data)
        copy.location = (3 * (i % 10), 3 * (i // 10), 0)
        bpy.context.scene.collection.objects.link(copy)
    scene = converted(token_budget=256)
    assert len(scene) <= 256 and len(scene.geometry) == 100 * FACES
    near = np.abs(np.mod(scene.geometry.triangles.mean(axis=1)[:, :2] + 1.5, 3) - 1.5)
    assert np.linalg.norm(near, axis=1).max() < 1.01
    np.testing.assert_allclose(base_colors(scene), np.tile((0.1, 0.6, 0.1), (len(scene.geometry), 1)), atol=1e-3)
    assert any("Max Triangles" in line for line in report.lines())


def test_cards_that_are_sampled_and_enlarged_stay_as_they_are_for_rays(converted, add_mesh):
    card = add_mesh("Card")
    for i in range(1, 400):
        copy = bpy.data.objects.new(f"Card {i}", card.data)
        copy.location = (i % 20, i // 20, 0)
        bpy.context.scene.collection.objects.link(copy)
    scene = converted(token_budget=100)
    assert len(scene) <= 100 and len(scene.geometry) == 400
    areas = np.linalg.norm(area_vectors(scene.geometry.triangles), axis=1)
    np.testing.assert_allclose(areas, 0.5, rtol=1e-5)
    assert np.linalg.norm(area_vectors(scene.triangles), axis=1).min() > 0.6


def test_where_there_are_too_many_triangles_the_finest_meshes_are_simplified(converted, report, monkeypatch):
    monkeypatch.setattr(real_surfaces, "MOST", FACES + 1000)
    ball("Coarse", (5, 0, 0)), ball("Fine").modifiers.new("Finer", "SUBSURF")
    scene = converted(token_budget=600)
    assert FACES < len(scene.geometry) <= FACES + 1000
    assert any("Fine: " in line and f"the scene has more than {FACES + 1000:,}" in line for line in report.lines())
