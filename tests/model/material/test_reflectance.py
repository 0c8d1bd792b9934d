# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest

from renderformer_v2.model.material.reflectance import layer_reflectance, normal_reflectance

PLASTIC = np.float32(1.3291)  # of a tile, as Blender's default: index 1.5 at Specular IOR Level 0.5


def test_the_default_layer_reflects_four_percent_at_normal_incidence():
    assert normal_reflectance(PLASTIC) == pytest.approx(0.04, abs=1e-4)


@pytest.mark.parametrize(("roughness", "expected"), [(0.15, 0.087), (0.5, 0.0575), (0.9, 0.027)])
def test_light_from_everywhere_is_reflected_as_cycles_glossy_color_has_it(roughness, expected):
    assert layer_reflectance(PLASTIC, np.float32(roughness)) == pytest.approx(expected, rel=0.1)


def test_no_layer_reflects_nothing():
    assert layer_reflectance(np.float32(1), np.float32(0.5)) == 0
