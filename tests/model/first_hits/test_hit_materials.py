# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of the surfaces that pixels show."""
import numpy as np

from renderformer_v2.model.first_hits.hit_materials import (
    hit_reflectances,
    hit_roughness,
    hit_roughness_below,
    least_hit_roughness,
)
from renderformer_v2.model.scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION
from tests.model.samples import floor_scene, floor_view


def test_what_a_surface_reflects_comes_from_the_texel_that_is_hit():
    """Plastic, metal, both, what has no layer at all, clear glass of the same ior, and what no token lies behind."""
    scene, (_, guides) = floor_scene(), floor_view()
    scene.tiles[:, BASE_COLOR] = 0.6
    guides.hit_triangle[0, 0] = -1
    for metallic, ior, transmission, expected in ((0, 1.3291, 0, (0, 0.6, 1, 0.04)),
                                                  (1, 1.3291, 0, (1, 0.6, 0, 0.04)),
                                                  (0.5, 1.3291, 0, (0.5, 0.6, 0.5, 0.04)),
                                                  (0, 1.0, 0, (0, 0.6, 0, 0)), (0, 1.5, 1, (0, 0.6, 1, 0.04))):
        scene.tiles[:, METALLIC], scene.tiles[:, IOR], scene.tiles[:, TRANSMISSION] = metallic, ior, transmission
        reflectances = hit_reflectances(scene, guides)
        np.testing.assert_allclose([picture[32, 32] for picture in reflectances], expected, atol=1e-3)
        np.testing.assert_allclose([reflectances[i][0, 0] for i in (0, 2, 3)], (0, 1, 0.04), atol=1e-6)


def test_roughness_comes_from_the_texel_that_is_hit():
    scene, (_, guides) = floor_scene(), floor_view()
    scene.tiles[0, 4, :, :16] = 0.25  # columns below 16: weight of corner 0 below one half
    roughness = hit_roughness(scene, guides)
    assert roughness[32, 32] == 0.25
    guides.hit_barycentric[...] = (0.8, 0.1)
    np.testing.assert_allclose(hit_roughness(scene, guides)[32, 32], 0.6, atol=1e-3)


def test_below_a_coat_a_surface_is_as_rough_as_it_was():
    """Its tile has the mean of both."""
    scene, (_, guides) = floor_scene(), floor_view()
    below, of_coat, share = 0.6, 0.1, 0.25
    guides.hit_triangle[0, 0] = -1
    scene.tiles[:, ROUGHNESS] = (1 - share) * below + share * of_coat
    scene.coat = np.float32([(0.5, 0.04, of_coat, share)])
    np.testing.assert_allclose(hit_roughness_below(scene, guides)[32, 32], below, atol=1e-3)
    np.testing.assert_allclose(least_hit_roughness(scene, guides)[32, 32], of_coat, atol=1e-3)
    assert least_hit_roughness(scene, guides)[0, 0] == 0.5
