# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles, rotations and panoramas agree with themselves and with simple cases."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.geometry import (
    area_vectors,
    barycentric,
    connected,
    contracted,
    corner_weights,
    euler_angles,
    latlong_directions,
    latlong_uv,
    quartered,
    rotation_matrix,
)


def test_area_vectors_point_to_the_front():
    assert area_vectors(np.array([(0, 0, 0), (2, 0, 0), (0, 3, 0)], float)).tolist() == [0, 0, 3]


def test_barycentric_weights_rebuild_points_of_the_plane_inside_and_outside():
    random = np.random.default_rng(1)
    triangles, weights = random.normal(size=(50, 3, 3)), random.normal(size=(50, 3))
    weights /= weights.sum(-1, keepdims=True)
    points = np.einsum("nk,nkx->nx", weights, triangles)
    np.testing.assert_allclose(barycentric(triangles, points), weights, atol=1e-6, rtol=1e-6)


def test_the_weights_of_two_corners_leave_the_rest_to_the_third():
    weights = np.random.default_rng(2).random((4, 5, 3))
    weights /= weights.sum(-1, keepdims=True)
    np.testing.assert_allclose(corner_weights(weights[..., :2]), weights)


@pytest.mark.parametrize("count", [1, 2, 50_000])
def test_a_chain_is_one_piece_in_whatever_order_its_links_come(count):
    points = np.random.default_rng(4).permutation(count)
    links = np.stack([points[:-1], points[1:]], axis=1)
    assert not connected(links, count).any()


def test_pieces_are_known_by_their_first_point():
    faces = np.array([(7, 8, 9), (1, 2, 3), (3, 4, 5), (9, 6, 7)])
    assert connected(faces, 11).tolist() == [0, 1, 1, 1, 1, 1, 6, 6, 6, 6, 10]


@pytest.mark.parametrize("kind", [np.asarray, torch.as_tensor])
def test_quarters_of_triangles_fill_them_and_face_the_same_way(kind):
    triangles = np.random.default_rng(3).normal(size=(5, 3, 3))
    quarters = np.asarray(quartered(kind(triangles))).reshape(4, 5, 3, 3)
    np.testing.assert_allclose(area_vectors(quarters), np.tile(area_vectors(triangles) / 4, (4, 1, 1)))
    np.testing.assert_allclose(quarters[:3, :, 0].swapaxes(0, 1), triangles)
    np.testing.assert_allclose(quarters[3].mean(1), triangles.mean(1))


def test_a_triangle_without_area_shares_equally():
    np.testing.assert_allclose(barycentric(np.ones((3, 3)), np.zeros(3)), np.full(3, 1 / 3))


@pytest.mark.parametrize("angles", [(0.3, -0.4, 2.0), (1.0, np.pi / 2, 0.5), (-3.0, 1.2, -2.5), (0, 0, 0)])
def test_euler_angles_rebuild_the_rotation(angles):
    rotation = rotation_matrix(np.array(angles))
    np.testing.assert_allclose(rotation_matrix(euler_angles(rotation)), rotation, atol=1e-9)


def test_panorama_texels_know_their_place():
    uv = latlong_uv(latlong_directions(np.arange(8), 8, 16))
    np.testing.assert_allclose(uv[:, 0, 1], 1 - (np.arange(8) + 0.5) / 8, atol=1e-6)
    np.testing.assert_allclose(uv[3, :, 0], (np.arange(16) + 0.5) / 16, atol=1e-6)


def test_contraction_keeps_the_near_and_draws_in_the_far():
    points = np.float32([(0.3, -0.4, 0.5), (0, 4, 0), (0, 0, -1e6)])
    np.testing.assert_allclose(contracted(points), [(0.3, -0.4, 0.5), (0, 1.75, 0), (0, 0, -2)], atol=1e-5)
