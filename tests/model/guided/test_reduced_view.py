# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray bundles of large pictures are told what those of small ones are."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.guided.features import FEATURES, SURFACE, guided_view
from renderformer_v2.model.guided.reduced_view import LARGEST, LONGEST, reduced, reduction_of
from renderformer_v2.model.weights.presets import rf2_small
from tests.model.samples import floor_scene, floor_view, scene_light

CONFIG = rf2_small()


def inputs(width, height):
    return guided_view(scene_light(floor_scene()), *floor_view(width, height), CONFIG)


@pytest.mark.parametrize(("side", "expected"), [(64, 1), (LONGEST, 1), (LONGEST + 1, 2), (4 * LONGEST, 4),
                                                (100 * LONGEST, LARGEST)])
def test_pictures_are_reduced_to_what_the_network_knows(side, expected):
    assert reduction_of(side) == expected


def test_small_pictures_stay_as_they_are():
    view = inputs(64, 64)
    assert reduced(view, 1, CONFIG) is view


def test_a_reduced_view_is_that_of_a_smaller_picture():
    small, large = inputs(64, 64), reduced(inputs(256, 256), 4, CONFIG)
    assert large.surface.shape == small.surface.shape
    torch.testing.assert_close(large.directions, small.directions, atol=1e-2, rtol=0)
    inner = (small.surface[:, SURFACE["alpha"]] == 1) & (large.surface[:, SURFACE["alpha"]] == 1)
    assert inner.any()
    differs = (large.features() - small.features()).abs() * inner
    assert differs.mean() < 5e-3
    assert (large.surface[:, SURFACE["noise"]] == small.surface[:, SURFACE["noise"]] / 4).all()
    of_floor = torch.nn.functional.avg_pool2d(inner.float(), CONFIG.patch_size).flatten() == 1
    torch.testing.assert_close(large.positions[:, of_floor], small.positions[:, of_floor], atol=1e-2, rtol=0)


def test_the_edge_is_repeated_to_the_end_of_a_window():
    view = reduced(inputs(192, 64), 2, CONFIG)
    assert view.surface.shape[2:] == view.directions.shape[1:3] == (64, 128)
    assert view.positions.shape == (1, 8 * 16, 3)
    features = view.features()
    assert features.isfinite().all()
    colors = features[:, FEATURES["colors"]]
    assert torch.equal(colors[..., 96:], colors[..., 95:96].expand_as(colors[..., 96:]))
    np.testing.assert_array_equal(colors[:, :, 32:], colors[:, :, 31:32].expand_as(colors[:, :, 32:]))
