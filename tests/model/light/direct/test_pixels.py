# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadows in pictures."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.light.effort import FULL, Effort
from renderformer_v2.model.light.estimate import estimate_light
from tests.model.samples import flat, floor_scene, floor_view, scene_light

PLATE = np.float32([[(0, -2, 1), (2, -2, 1), (2, 2, 1)], [(0, -2, 1), (2, 2, 1), (0, 2, 1)]])  # its edge crosses x = 0


def visible(size: float, effort: Effort = FULL) -> torch.Tensor:
    """(32, 40) how much of a lamp of some size, two above a floor, arrives in pixels, past a plate over half of it."""
    bare, (view, guides) = floor_scene(), floor_view()
    lamp = bare.triangles[bare.is_light]
    bare.triangles[bare.is_light] = size * (lamp - lamp.mean(axis=(0, 1))) + np.float32((0, 0, 2))
    shaded, lit = (estimate_light(scene_light(scene), view, guides, effort).direct[0, 0].mean(0)[16:48, 12:52]
                   for scene in (bare.appended(flat(PLATE, (0.8, 0.8, 0.8))), bare))
    return shaded / lit


def test_shadows_of_small_lamps_are_sharp_and_their_edges_antialiased():
    across = visible(0.05)[12:20].mean(0)
    assert across[:18].min() > 0.99 and across[22:].max() < 0.01
    assert ((across > 0.05) & (across < 0.95)).sum() in (1, 2)


def test_shadows_of_wide_lamps_are_smooth():
    steps = visible(4.0)[12:20].mean(0).diff()
    assert steps.max() < 0.01 and steps.min() > -0.15
    assert (steps < -0.02).sum() > 8


@pytest.mark.parametrize("size, error", [(0.5, 0.025), (4.0, 0.05)])
def test_penumbras_of_the_few_rays_of_large_pictures_are_those_of_many(size, error):
    few, many = (visible(size, replace(FULL, rays=rays, most_more=1.0)) for rays in (1.0, 32.0))
    assert (few - many).square().mean().sqrt() < error
