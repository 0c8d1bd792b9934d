# SPDX-License-Identifier: GPL-3.0-or-later
"""Token budget and triangle size."""
import sys

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model import progress
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.meshes import read_mesh
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data import mesh as meshes
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.fitting.budget import share_budget
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.meshes import nearest, qslim, reduce
from mathutils import Vector
from mathutils.geometry import closest_point_on_tri


@pytest.fixture(params=["installed", "missing"], autouse=True)
def package(request, monkeypatch):
    """With the package that simplifies meshes, and with our own way where it is missing."""
    if request.param == "missing":
        monkeypatch.setitem(sys.modules, "fast_simplification", None)


def test_budget_keeps_shape(converted, report):
    bpy.ops.mesh.primitive_monkey_add()
    bpy.context.object.modifiers.new("subdivide", "SUBSURF").render_levels = 3
    bpy.context.object.modifiers["subdivide"].levels = 3
    full, small = converted(), converted(token_budget=2000)
    assert len(full) > 50_000 and 1900 < len(small) <= 2000
    assert meshes.areas(small.triangles).sum() == pytest.approx(meshes.areas(full.triangles).sum(), rel=0.02)
    size = np.ptp(full.triangles, axis=(0, 1)).max()
    for bound in (np.min, np.max):
        ours, wanted = (bound(s.triangles, axis=(0, 1)) for s in (small, full))
        np.testing.assert_allclose(ours, wanted, atol=0.01 * size)
    assert [e[:2] for e in report.entries] == [("approximated", "Suzanne")]


def test_simplified_mesh_keeps_uv_and_material_borders(report):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=60, y_subdivisions=60)
    obj = bpy.context.object
    obj.data.polygons.foreach_set("material_index", np.repeat([0, 1], 1800))
    mesh = reduce.simplify(read_mesh(obj.data, "grid", report), 300)
    np.testing.assert_allclose(mesh.uv["UVMap"], (mesh.corners[..., :2] + 1) / 2, atol=1e-4)
    above = mesh.corners.mean(axis=1)[:, 1] > 0
    np.testing.assert_array_equal(above, mesh.slot)
    assert meshes.areas(mesh.corners).sum() == pytest.approx(4, rel=1e-4)


def test_cylinder_keeps_its_hard_edges(report):
    bpy.ops.mesh.primitive_cylinder_add(vertices=400)
    mesh = reduce.simplify(read_mesh(bpy.context.object.data, "cylinder", report), 200)
    vertical = np.abs(mesh.normals[..., 2])
    cap = np.abs(meshes.face_normals(mesh.corners)[:, 2]) > 0.7
    assert vertical[cap].min() > 0.99 and vertical[~cap].max() < 0.01


def test_emission_keeps_its_flux_when_simplified(converted, add_material):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
    bpy.context.object.data.materials.append(add_material("lamp", emission=7))
    scene = converted(token_budget=100)
    assert 50 < len(scene) <= 100
    flux = (scene.emission * meshes.areas(scene.triangles)[:, None]).sum(axis=0)
    full = converted()
    np.testing.assert_allclose(flux, 7 * meshes.areas(full.triangles).sum(), rtol=1e-3)


def test_small_meshes_are_kept_and_shares_fit():
    shares = share_budget([12, 100_000, 3000], [5, 1, 10], [1, 100, 10], 8000)
    assert shares[0] == 12 and (shares * [5, 1, 10]).sum() <= 8000 and (shares > 60).tolist() == [False, True, True]


def test_more_instances_than_budget_keeps_the_largest(converted, add_mesh, report):
    for i in range(20):
        add_mesh(f"t{i}").scale = (i + 1,) * 3
    scene = converted(token_budget=5)
    assert sorted(meshes.longest_edges(scene.triangles) / np.sqrt(2)) == pytest.approx([16, 17, 18, 19, 20])
    assert len([1 for kind, _, _ in report.entries if kind == "unplaced"]) == 15


def test_large_triangles_are_split_and_lights_are_not(converted, add_material):
    bpy.ops.mesh.primitive_plane_add(size=2)
    bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 0, 1))
    bpy.context.object.data.materials.append(add_material("lamp", emission=7))
    scene = converted(max_edge=0.1)
    assert np.count_nonzero(scene.is_light) == 2
    floor = scene.triangles[~scene.is_light]
    assert meshes.areas(floor).sum() == pytest.approx(4)
    assert meshes.longest_edges(floor).max() <= 0.2
    assert (meshes.face_normals(floor)[:, 2] > 0.999).all()


def test_short_budget_splits_the_largest_first(converted, add_mesh):
    add_mesh("large").scale = (8, 8, 8)
    add_mesh("small")
    scene = converted(token_budget=20, max_edge=0.001)
    assert len(scene) == 20
    assert meshes.longest_edges(scene.triangles).max() == pytest.approx(np.sqrt(8))  # of sqrt(128) when whole
    assert np.isclose(meshes.areas(scene.triangles), 0.5).sum() == 1  # the small one, whole


@pytest.fixture
def in_blocks(monkeypatch):
    """Large meshes begin at 600 triangles."""
    monkeypatch.setattr(nearest.divide, "__defaults__", (300,))
    monkeypatch.setattr(qslim, "WHOLE", 600)


def test_a_very_large_mesh_is_simplified_in_blocks_without_cracks(in_blocks, report):
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=5)
    mesh = read_mesh(bpy.context.object.data, "ball", report)
    told = []
    with progress.reporting(lambda text, fraction: told.append(fraction)):
        small = reduce.simplify(mesh, 500)
    assert 480 < len(small) <= 500 and told == sorted(told)
    assert len(told) > 3 * len(mesh) / 300  # Esc is looked at block by block
    _, faces = reduce.weld(small.corners)
    edges = np.sort(np.stack([faces, np.roll(faces, 1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    closed = np.unique(edges, axis=0, return_counts=True)[1] == 2
    assert closed.mean() > (0.99 if sys.modules["fast_simplification"] is None else 1 - 1e-9)  # ours may lose a sliver
    np.testing.assert_allclose(np.linalg.norm(small.corners, axis=-1), 1, atol=0.03)


def test_the_nearest_triangle_is_found_in_whatever_block_it_is(in_blocks, report):
    bpy.ops.mesh.primitive_monkey_add()
    corners = read_mesh(bpy.context.object.data, "monkey", report).corners.astype(np.float64)
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (50, 3))
    faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    found = nearest.NearestTriangles(corners.reshape(-1, 3), faces).nearest(points)
    for point, triangle in zip(points, found, strict=True):
        near, wanted = (min(np.linalg.norm(Vector(point) - closest_point_on_tri(Vector(point), *map(Vector, some)))
                            for some in candidates) for candidates in (corners[[triangle]], corners))
        assert near == pytest.approx(wanted, abs=1e-5)
