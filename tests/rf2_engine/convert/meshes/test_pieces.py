# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of many separate sampling."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.rays import Rays
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.meshes import read_mesh
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.meshes import reduce, sampling

LEAVES, LEAF = 6000, 0.02  # how many, and half a side


def test_a_crown_of_fewer_leaves_lets_as_much_light_through(report):
    full = read_mesh(_crown(), "crown", report)
    small = reduce.simplify(full, 3000)
    assert 2000 < len(small) <= 3000
    assert small.area == pytest.approx(full.area, rel=0.02)
    assert _passing(small) == pytest.approx(_passing(full), abs=0.05)
    np.testing.assert_allclose(small.bounds, full.bounds, atol=5 * LEAF)
    assert set(np.unique(small.uv["UVMap"])) == {0, 1}


def test_what_is_large_among_many_pieces_is_kept_as_it_is(report):
    bpy.ops.mesh.primitive_cylinder_add(radius=0.1, depth=2, location=(0, 0, -1), vertices=32)
    trunk = bpy.context.object
    alone = read_mesh(trunk.data, "trunk", report)
    crown = bpy.data.objects.new("Crown", _crown())
    bpy.context.collection.objects.link(crown)
    with bpy.context.temp_override(active_object=trunk, selected_editable_objects=[trunk, crown]):
        bpy.ops.object.join()
    full = read_mesh(trunk.data, "tree", report)
    assert len(full) == len(alone) + 2 * LEAVES
    points, faces = reduce.weld(full.corners)
    some = sampling.thin_pieces(full, points, faces, 3000, None)
    assert {tuple(corners) for corners in alone.corners.reshape(-1, 9).tolist()} <= {
        tuple(corners) for corners in some.corners.reshape(-1, 9).tolist()}
    assert len(some) < 3000 and some.area == pytest.approx(full.area, rel=0.02)


def test_no_piece_becomes_larger_than_a_tenth_of_the_mesh(report):
    some = reduce.simplify(read_mesh(_crown(), "crown", report), 60)
    extent = np.ptp(some.corners, axis=1).max()
    assert 4 * LEAF < extent < 0.11 * 2


def test_small_pieces_of_little_area_are_not_enlarged(report):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1, segments=16)
    body = bpy.context.object
    screws = bpy.data.objects.new("Screws", _crown())
    bpy.context.collection.objects.link(screws)
    screws.scale = [0.1] * 3
    with bpy.context.temp_override(active_object=body, selected_editable_objects=[body, screws]):
        bpy.ops.object.join()
    mesh = read_mesh(body.data, "machine", report)
    assert sampling.thin_pieces(mesh, *reduce.weld(mesh.corners), 1000, None) is mesh


@pytest.mark.parametrize("target", [600, 20_000])
def test_a_mesh_whose_pieces_fit_keeps_them_all(target, report):
    bpy.ops.mesh.primitive_monkey_add()
    bpy.ops.object.modifier_add(type="SUBSURF")
    bpy.ops.object.modifier_apply(modifier="Subdivision")
    mesh = read_mesh(bpy.context.object.data, "monkey", report)
    assert sampling.thin_pieces(mesh, *reduce.weld(mesh.corners), target, None) is mesh


def _crown() -> bpy.types.Mesh:
    """Square leaves all through a ball of radius 1, turned at random."""
    random = np.random.default_rng(1)
    middle, a, b = random.normal(size=(3, LEAVES, 3))
    middle *= random.uniform(size=(LEAVES, 1)) ** (1 / 3) / np.linalg.norm(middle, axis=1)[:, None]
    a /= np.linalg.norm(a, axis=1)[:, None]
    b = np.cross(a, b)
    b /= np.linalg.norm(b, axis=1)[:, None]
    corners = [middle + LEAF * (u * a + v * b) for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh = bpy.data.meshes.new("Crown")
    mesh.from_pydata(np.stack(corners, axis=1).reshape(-1, 3).tolist(), [],
                     np.arange(4 * LEAVES).reshape(-1, 4).tolist())
    mesh.uv_layers.new().uv.foreach_set("vector", np.tile(np.float32([0, 0, 1, 0, 1, 1, 0, 1]), LEAVES))
    return mesh


def _passing(mesh) -> float:
    """The share of rays from above through the middle of the ball that meet nothing."""
    side = np.linspace(-0.7, 0.7, 60)
    starts = np.stack([*(axis.ravel() for axis in np.meshgrid(side, side)), np.full(3600, 3.0)], axis=1)
    hit = Rays(mesh.corners).closest(starts, np.tile((0.0, 0.0, -1.0), (3600, 1))).triangle
    return float((hit < 0).mean())
