# SPDX-License-Identifier: GPL-3.0-or-later
"""Each triangle of a mesh finds the token that stands for it."""
from dataclasses import replace

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.meshes import read_mesh
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data import mesh as meshes
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.mesh import TriangleMesh
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.meshes import reduce
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.meshes.represent import represent


def grid(cells: int) -> TriangleMesh:
    """The square [-1, 1]^2."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=cells, y_subdivisions=cells, size=2)
    return read_mesh(bpy.context.object.data, "Grid", Report())


def box_of(corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(n,) bool: points (n, 3) are in the bounding boxes of triangles (n, 3, 3)."""
    return ((point >= corners.min(axis=1) - 1e-5) & (point <= corners.max(axis=1) + 1e-5)).all(axis=1)


def test_a_crumb_has_the_token_that_it_lies_in(scene):
    fine, tokens = grid(64), grid(4)
    mesh, token = represent(fine, tokens, is_textured=False)
    assert mesh is fine and box_of(tokens.corners[token], meshes.middles(fine.corners)).mean() > 0.95


@pytest.mark.parametrize("is_textured", [True, False])
def test_a_large_triangle_with_a_texture_is_cut_as_finely_as_its_tokens(scene, is_textured):
    """Or a picture on it would be that of one token's tile."""
    mesh, token = represent(grid(1), grid(16), is_textured)
    if not is_textured:
        assert len(mesh) == len(token) == 2
        return
    longest, of_token = meshes.longest_edges(mesh.corners), meshes.longest_edges(grid(16).corners)
    assert len(mesh) == len(token) > 200 and (longest <= 1.5 * of_token[token]).all()
    assert meshes.areas(mesh.corners).sum() == pytest.approx(4)
    np.testing.assert_allclose(mesh.uv["UVMap"], (mesh.corners[..., :2] + 1) / 2, atol=1e-5)


def test_the_two_sides_of_a_thin_board_have_tokens_of_their_own(scene):
    bpy.ops.mesh.primitive_cube_add(size=2)
    bpy.context.object.scale = (1, 1, 0.02)
    bpy.ops.object.transform_apply(scale=True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=30)
    bpy.ops.object.mode_set(mode="OBJECT")
    mesh = read_mesh(bpy.context.object.data, "Board", Report())
    tokens = reduce.simplify(mesh, 200)
    _, token = represent(mesh, tokens, is_textured=False)
    own, other = (meshes.face_normals(corners)[:, 2] for corners in (mesh.corners, tokens.corners[token]))
    assert ((own * other)[np.abs(own) > 0.9] > 0.9).mean() > 0.98


def test_a_material_without_tokens_of_its_own_takes_the_nearest(scene):
    fine, tokens = grid(16), grid(4)
    fine = replace(fine, slot=np.where(meshes.middles(fine.corners)[:, 0] > 0.9, 1, 0).astype(np.int32))
    _, token = represent(fine, tokens, is_textured=False)
    assert box_of(tokens.corners[token], meshes.middles(fine.corners)).mean() > 0.95
