# SPDX-License-Identifier: GPL-3.0-or-later
"""Beams of lights: what is exact for Spread, and what networks are told of it."""
import math

import numpy as np
import pytest

from renderformer_v2.model.beams import SPREAD, beam_share, smoothed, spread_borders
from tests.model.light.direct.test_direct_light import diffuse, lit_by


@pytest.mark.parametrize("degrees", [1, 20, 60, 110, 170])
def test_networks_are_told_of_as_much_light_and_the_same_border(degrees):
    gain, borders = spread_borders(math.radians(degrees))
    told, smooth = smoothed(np.float64([[gain] * 3, [1, 2, 3]]), np.float64([borders, (0.5, 0.6)]))
    assert smooth[0, 0] == borders[0] < smooth[0, 1] != SPREAD
    angle = np.linspace(0, math.radians(degrees) / 2, 2000)
    flux = [(beam_share(np.cos(angle), pair) * np.cos(angle) * np.sin(angle)).sum() for pair in (borders, smooth[0])]
    assert told[0, 0] * flux[1] == pytest.approx(gain * flux[0], rel=0.01)
    assert told[1].tolist() == [1, 2, 3] and smooth[1].tolist() == [0.5, 0.6]


@pytest.mark.parametrize("degrees, size", [(20, (0.3, 0.3)), (60, (1.2, 0.3)), (110, (1.2, 0.3)), (160, (0.3, 0.3))])
@pytest.mark.parametrize("x", [(0, 0, 0), (0.3, 0.2, 0)])
def test_a_lamp_with_a_spread_lights_a_floor_as_the_integral_says(degrees, size, x):
    _, borders = spread_borders(math.radians(degrees))
    corner = np.float32([(x, y, 0) for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]) * (*size, 0) / 2 + (0, 0, 2)
    u, v = np.meshgrid(*[(np.arange(400) + 0.5) / 400 - 0.5] * 2)
    to = np.stack([u * size[0], v * size[1], np.full_like(u, 2.0)], -1) - x
    distance = np.linalg.norm(to, axis=-1)
    cosine = to[..., 2] / distance
    expected = (beam_share(cosine, borders) * (cosine / distance) ** 2).mean() * np.prod(size) / math.pi
    scene = lit_by(corner[[(0, 1, 2), (0, 2, 3)]], axis=(0, 0, -1), cosine=borders)
    assert diffuse(scene, x, (0, 0, 1))[0] == pytest.approx(expected, rel=0.03)
