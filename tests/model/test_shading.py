# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface has its own normals, and the material of the token that stands for it."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.geometry import reflected
from renderformer_v2.model.scene import BASE_COLOR, EMISSION_SIZE, TILE_SIZE, Geometry
from renderformer_v2.model.shading import (
    GRAZING,
    RISE,
    bent_to_reflect,
    emission_share,
    on_tokens,
    shading_normals,
    side_normals,
    surface,
)
from tests.model.samples import flat

TOKEN = np.float32([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]])
CRUMBS = np.float32([[(0.6, 0.2, 0.1), (0.8, 0.2, 0.1), (0.6, 0.3, 0.2)],
                     [(0.1, 0.7, 0), (0.2, 0.7, 0), (0.1, 0.9, 0)]])


def crumbs_of_a_token():
    """A token whose red grows along its row, and two triangles that it stands for, with normals of their own."""
    scene = flat(TOKEN, (0.5, 0.5, 0.5))
    scene.tiles[0, BASE_COLOR.start] = np.linspace(0, 1, TILE_SIZE)[None]  # by the weight of corner 0
    normals = np.float32([[(0, 0, 1)] * 3, [(0, 0.6, 0.8)] * 3])
    return replace(scene, geometry=Geometry(CRUMBS, normals, np.zeros(2, np.int32)))


def test_the_material_is_that_of_the_nearest_point_of_the_token():
    scene, point = crumbs_of_a_token(), CRUMBS.mean(axis=1)
    normal, behind, texel = surface(scene, np.arange(2), point, np.float32([(0, 0, -1)] * 2))
    np.testing.assert_allclose(texel[:, BASE_COLOR.start], 1 - point[:, 0] - point[:, 1], atol=1 / TILE_SIZE)
    np.testing.assert_allclose(normal, scene.geometry.normals[:, 0], atol=1e-6)
    assert behind.tolist() == [False, False]


def test_pictures_stay_with_their_triangles_when_scenes_are_joined():
    size, bare, scenes = EMISSION_SIZE, crumbs_of_a_token(), []
    for red in (1, 2):
        tile = np.full((1, 3, size, size), red, np.float16)
        scenes.append(replace(crumbs_of_a_token(), emission_tile=np.int32([0]), emission_tiles=tile))
    joined = bare.appended(scenes[0], bare, scenes[1])
    joined.validate()
    point = np.concatenate([CRUMBS.mean(axis=1)] * 4)
    share = emission_share(joined, np.arange(8), point)
    assert share[:, 0].tolist() == [1, 1, 1, 1, 1, 1, 2, 2]
    assert bare.appended(bare).emission_tile is None and bare.appended(bare).emission_tiles is None


def test_weights_on_tokens_are_those_of_the_same_place():
    scene = crumbs_of_a_token()
    token, weights = on_tokens(scene, np.int32([0, 1]), np.full((2, 2), 1 / 3, np.float32))
    point = weights @ TOKEN[0, :2] + (1 - weights.sum(1, keepdims=True)) * TOKEN[0, 2]
    assert token.tolist() == [0, 0]
    np.testing.assert_allclose(point[:, :2], CRUMBS.mean(axis=1)[:, :2], atol=1e-6)


def test_beyond_the_token_its_rim_counts():
    scene = crumbs_of_a_token()
    scene.geometry.triangles += np.float32((0, 2, 0))
    token, weights = on_tokens(scene, np.int32([0]), np.float32([(0.2, 0.2)]))
    assert token[0] == 0 and weights[0].min() >= 0 and weights[0].sum() <= 1


def test_normals_are_on_the_side_that_is_seen():
    scene, third = flat(TOKEN, (0.5, 0.5, 0.5)), np.float32([[1 / 3] * 3])
    scene.normals[:] = 0, 0.6, 0.8
    for ray, expected in (((0, 0, -1), (0, 0.6, 0.8)), ((0, 0, 1), (0, -0.6, -0.8))):
        normal = shading_normals(scene, np.array([0]), third, np.float32([ray]))
        np.testing.assert_allclose(normal, [expected], atol=1e-6)


def test_normals_that_lean_away_from_the_viewer_are_bent():
    scene, third, ray = flat(TOKEN, (0.5, 0.5, 0.5)), np.float32([[1 / 3] * 3]), np.float32([(0, 0.96, -0.28)])
    scene.normals[:] = 0, 0.6, 0.8
    normal, = shading_normals(scene, np.array([0]), third, ray)
    assert normal @ ray[0] == pytest.approx(-GRAZING, abs=3e-3)
    assert normal[0] == 0 and normal[2] > 0.8 and np.linalg.norm(normal) == pytest.approx(1)


def test_where_normals_of_the_back_prevail_the_front_has_them():
    """Smooth shading of a thin plate gives its corners normals of both sides; Cycles shades them so, and black."""
    scene, ray = flat(TOKEN, (0.5, 0.5, 0.5)), np.float32([(0, 0, -1)])
    scene.normals[:] = [(0, 0, 1), (0, 0, -1), (0, 0, -1)]
    for weights, expected in (((0.8, 0.1, 0.1), 1), ((0.2, 0.4, 0.4), -1)):
        normal = shading_normals(scene, np.array([0]), np.float32([weights]), ray)
        np.testing.assert_allclose(normal, [(0, 0, expected)], atol=1e-6)


def test_normals_are_bent_until_what_they_mirror_rises_above_the_facet():
    ray, side = np.float32([(0, 0.8, -0.6)]).repeat(2, 0), np.float32([(0, 0, 1)]).repeat(2, 0)
    leaning = np.float32([(0, 0.6, 0.8), (0, -0.28, 0.96)])  # away from the viewer, and toward
    normal = bent_to_reflect(leaning, side, ray)
    mirrored = reflected(ray, normal)
    assert reflected(ray, leaning)[0, 2] < 0 and mirrored[0, 2] == pytest.approx(RISE, abs=1e-5)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-6)
    np.testing.assert_array_equal(normal[1], leaning[1])


def test_side_normals_face_the_viewer_and_not_the_corners_normals():
    scene = flat(TOKEN, (0.5, 0.5, 0.5))
    scene.normals[:] = 0, 0.6, 0.8
    for z in (1, -1):
        np.testing.assert_allclose(side_normals(scene, np.array([0]), np.float32([(0, 0, -z)])), [(0, 0, z)])
