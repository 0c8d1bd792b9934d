# SPDX-License-Identifier: GPL-3.0-or-later
"""Reflectance of dielectric layers, and GGX facets."""
import numpy as np
import pytest

from renderformer_v2.model.geometry import dot, unit
from renderformer_v2.model.material.reflectance import (
    fresnel,
    normal_reflectance,
    unmasked,
    visible_facets,
)

PLASTIC = np.float32(1.3291)  # of a tile, as Blender's default: index 1.5 at Specular IOR Level 0.5


def test_the_default_layer_reflects_four_percent_at_normal_incidence():
    assert normal_reflectance(PLASTIC) == pytest.approx(0.04, abs=1e-4)


COUNT = 100_000


def test_glass_mirrors_four_percent_straight_on_and_all_light_that_grazes_it_or_cannot_leave_it():
    found = fresnel(np.array([1.0, 0.0, 1.0, 0.7]), np.array([1.5, 1.5, 1 / 1.5, 1 / 1.5]))
    np.testing.assert_allclose(found, [0.04, 1.0, 0.04, 1.0], atol=1e-6)


def test_at_brewsters_angle_one_polarisation_alone_is_mirrored():
    angle = np.arctan(1.5)
    across = np.sin(angle - np.arcsin(np.sin(angle) / 1.5)) ** 2  # sin^2(a - b) / sin^2(a + b), a + b = 90 degrees
    assert fresnel(np.cos([angle]), np.array([1.5]))[0] == pytest.approx(across / 2, rel=1e-6)


@pytest.mark.parametrize("alpha", [0.05, 0.45])
@pytest.mark.parametrize("cosine", [1.0, 0.5])
def test_facets_are_as_frequent_as_rays_meet_them(alpha, cosine):
    """Their mean cosine with the surface, by integration over the hemisphere."""
    normal = np.tile(unit(np.array([[0.3, -0.5, 0.8]])), (COUNT, 1))
    aside = unit(np.cross(normal, [[0, 0, 1]]))
    ray = np.sqrt(1 - cosine**2) * aside - cosine * normal
    found = visible_facets(normal, ray, np.full(COUNT, alpha), np.random.default_rng(0).random((COUNT, 2)))
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-5)
    assert (dot(found, ray) < 1e-6).all()
    z, phi = np.meshgrid((np.arange(4000) + 0.5) / 4000, (np.arange(400) + 0.5) / 400 * 2 * np.pi)
    density = alpha**2 / (np.pi * (1 + (alpha**2 - 1) * z**2) ** 2)
    seen = (np.sqrt(1 - cosine**2) * np.sqrt(1 - z**2) * np.cos(phi) + cosine * z).clip(0) * density
    assert dot(found, normal).mean() == pytest.approx((seen * z).sum() / seen.sum(), abs=2e-3)


def test_facets_of_smooth_glass_hide_nothing_and_those_of_rough_glass_what_leaves_along_it():
    ways = np.array([1.0, 0.5, 0.1])
    np.testing.assert_allclose(unmasked(ways, ways, np.full(3, 1e-4)), 1, atol=1e-5)
    rough = unmasked(np.ones(3), ways, np.full(3, 0.45))
    assert rough[0] == 1 and (np.diff(rough) < -0.01).all()
