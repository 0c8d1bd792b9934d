# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of the surfaces that pixels show."""
import numpy as np
import pytest

from renderformer_v2.model.first_hits.hit_materials import (
    hit_reflectances,
    hit_roughness,
    hit_roughness_below,
    least_hit_roughness,
)
from renderformer_v2.model.pictures import LUMINANCE
from renderformer_v2.model.scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION, constant_tile
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


@pytest.mark.parametrize("clear", [0.1, 0.5, 0.9])
def test_a_leaf_is_as_rough_where_alpha_fades(clear):
    """A tile mixes it with a window, which is perfectly smooth and has no layer; a hole in it says nothing of it."""
    color, rough, f0 = np.float32((0.1, 0.3, 0.05)), 0.4, 0.04
    scene, (_, guides) = floor_scene(), floor_view()
    luminance = (1 - clear) * color @ LUMINANCE + clear
    gloss = clear, (1 - clear) * f0 / 2
    scene.tiles[:] = constant_tile(color * (1 - clear) + clear, roughness=rough * gloss[1] / sum(gloss),
                                   ior=1.3291 * (1 - clear) + clear, transmission=clear / luminance)
    scene.tiles[:, :, :16] = constant_tile((1, 1, 1), roughness=0, ior=1, transmission=1)[:, :16]
    scene.clear = np.full((1, 3), (1 + clear) / 2, np.float32)
    guides.hit_barycentric[...] = (0.3, 0.6)
    guides.hit_barycentric[32, 30] = (0.3, 0.2)
    roughness, (_, _, layer, layer_f0) = hit_roughness(scene, guides), hit_reflectances(scene, guides)
    assert roughness[32, 32] == pytest.approx(rough, abs=0.06) and layer_f0[32, 32] == pytest.approx(0.04, abs=0.02)
    assert (roughness[32, 30], layer[32, 30], layer_f0[32, 30]) == pytest.approx((0.5, 1, 0.04))
