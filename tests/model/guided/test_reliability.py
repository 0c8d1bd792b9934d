# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise in which traced light is lost."""
import pytest
import torch

from renderformer_v2.model.guided.reliability import unreliable_share


def light(radiance: float) -> torch.Tensor:
    return torch.full((1, 3, 32, 48), radiance)


def noise(deviation: float) -> torch.Tensor:
    return deviation * torch.randn(1, 1, 32, 48, generator=torch.manual_seed(0)).expand(1, 3, 32, 48)


@pytest.mark.parametrize("deviation, least, most", [(0, 0, 0), (0.1, 0, 0.01), (1.5, 0.35, 0.5), (20, 0.7, 1)])
def test_the_more_noise_there_is_the_more_of_the_light_is_lost(deviation, least, most):
    share = unreliable_share(light(1.0), noise(deviation), light(1.0))
    assert share.shape == (1, 1, 32, 48) and least <= share.mean() <= most


def test_an_estimate_that_is_wrong_in_the_mean_is_not_believed():
    right, wrong = (unreliable_share(light(1.0), noise(4.0), light(estimate)) for estimate in (1.0, 6.0))
    assert right.mean() > 0.6 and wrong.mean() < 0.05


def test_darkness_is_reliable():
    assert unreliable_share(light(0.0), noise(1e-3), light(0.0)).max() < 0.01
