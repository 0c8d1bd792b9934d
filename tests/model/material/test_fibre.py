# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that hair scatters: none is lost without absorption, and what is left of it follows the pigment."""
import numpy as np
import pytest

from renderformer_v2.model.material.fibre import absorption_of_color, absorption_of_melanin, albedo

GLASSY = np.float32([1.55])


def test_a_fibre_without_pigment_loses_nothing():
    back, on = albedo(np.zeros(3), GLASSY)
    np.testing.assert_allclose(back + on, 1, atol=1e-3)


def test_black_hair_reflects_as_a_glass_rod_does():
    back, on = albedo(np.full(3, 50.0), GLASSY)
    angle = np.linspace(0, np.pi / 2, 2000)
    inner = np.arcsin(np.sin(angle) / GLASSY)
    angle, inner = angle[1:], inner[1:]
    less, more = angle - inner, angle + inner
    fresnel = (np.sin(less) / np.sin(more)) ** 2 + (np.tan(less) / np.tan(more)) ** 2
    np.testing.assert_allclose(back, (fresnel / 2 * np.cos(angle)).sum() * angle[0], atol=2e-3)
    assert (on < 1e-3).all()


@pytest.mark.parametrize("color", [0.02, 0.3, 0.9])
def test_lighter_hair_absorbs_less_and_scatters_more(color):
    darker, lighter = (sum(albedo(absorption_of_color(np.full(3, c), 0.3), GLASSY)) for c in (color / 2, color))
    assert (darker < lighter).all() and (lighter <= 1).all()


def test_melanin_makes_hair_dark_and_pheomelanin_red():
    brown, red = (absorption_of_melanin(np.float32([0.6]), np.float32([share])) for share in (0, 1))
    assert not absorption_of_melanin(np.float32([0]), np.float32([1])).any()
    assert (np.diff(brown) > 0).all() and red[2] / red[0] > brown[2] / brown[0]


def test_values_of_many_points_are_those_of_one():
    absorption = np.float32([[0, 0.5, 1], [2, 3, 4]])
    for many, first in zip(albedo(absorption, np.float32([[1.55], [1.4]])), albedo(absorption[0], GLASSY)):
        np.testing.assert_allclose(many[0], first, rtol=1e-5)
