# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadows in pictures."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.light.estimate import estimate_light
from tests.model.samples import flat, floor_scene, floor_view, scene_light

PLATE = np.float32([[(0, -2, 1), (2, -2, 1), (2, 2, 1)], [(0, -2, 1), (2, 2, 1), (0, 2, 1)]])  # its edge crosses x = 0


@pytest.fixture
def shadow():
    """Function: how much of a lamp of some size, two above a floor, arrives in pixels from left to right, (40,)."""
    def picture(size: float) -> torch.Tensor:
        bare, (view, guides) = floor_scene(), floor_view()
        lamp = bare.triangles[bare.is_light]
        bare.triangles[bare.is_light] = size * (lamp - lamp.mean(axis=(0, 1))) + np.float32((0, 0, 2))
        shaded, lit = (estimate_light(scene_light(scene), view, guides).direct[0, 0].mean(0)
                       for scene in (bare.appended(flat(PLATE, (0.8, 0.8, 0.8))), bare))
        return (shaded / lit)[28:36, 12:52].mean(0)
    return picture


def test_shadows_of_small_lamps_are_sharp_and_their_edges_antialiased(shadow):
    visible = shadow(0.05)
    assert visible[:18].min() > 0.99 and visible[22:].max() < 0.01
    assert ((visible > 0.05) & (visible < 0.95)).sum() in (1, 2)


def test_shadows_of_wide_lamps_are_smooth(shadow):
    steps = shadow(4.0).diff()
    assert steps.max() < 0.01 and steps.min() > -0.15
    assert (steps < -0.02).sum() > 8
