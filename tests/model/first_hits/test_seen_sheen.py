# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits by rays have sheen as the camera sees it."""
import numpy as np
import pytest

from renderformer_v2.model.first_hits.camera_rays import cast_guides
from renderformer_v2.model.material.sheen import albedo, mean_albedo
from tests.model.samples import floor_scene, floor_view

COLOR, ROUGHNESS = (0.2, 0.5, 0.8), 0.6


def test_a_floor_has_the_sheen_of_each_pixels_view():
    scene, (view, _) = floor_scene(), floor_view(32, 32)
    view.camera_to_world[2, 3], view.focal[:] = 0.3, 10.0
    plain = cast_guides(scene, view)
    scene.sheen = np.float32([(*COLOR, ROUGHNESS)])
    guides = cast_guides(scene, view)
    hit = (guides.hit_triangle >= 0) & (guides.emission == 0).all(-1)
    cosine = (0.3 / np.linalg.norm(guides.position - view.camera_to_world[:3, 3], axis=-1))[hit]
    more = (guides.diffuse_color - plain.diffuse_color)[hit]
    expected = albedo(cosine, np.float32(ROUGHNESS)) - mean_albedo(np.float32([ROUGHNESS]))
    assert np.ptp(cosine) > 0.5
    np.testing.assert_allclose(more, np.outer(expected, COLOR), atol=2e-3)


@pytest.mark.parametrize("coverage", [0.0, 1.0])
def test_nothing_is_added_where_there_is_none(coverage):
    scene, (view, _) = floor_scene(), floor_view(16, 16)
    plain = cast_guides(scene, view)
    scene.sheen = np.float32([(0, 0, 0, coverage)])
    np.testing.assert_array_equal(cast_guides(scene, view).diffuse_color, plain.diffuse_color)
