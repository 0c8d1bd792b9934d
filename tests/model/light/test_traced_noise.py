# SPDX-License-Identifier: GPL-3.0-or-later
"""The noise of traced light goes where its estimate is right, and what the estimate lacks stays."""
import pytest
import torch

from renderformer_v2.model.light import traced_noise
from renderformer_v2.model.light.traced_noise import without_noise

SIZE = 64
EDGE = SIZE // 2
NOISE = 0.3


@pytest.fixture
def surface():
    """(1, 7, H, W) of two walls with an edge between them."""
    surface = torch.zeros(1, 7, SIZE, SIZE)
    surface[:, 0, :, :EDGE], surface[:, 1, :, EDGE:] = 1, 1
    return surface


def traced(light: torch.Tensor) -> torch.Tensor:
    """Light (1, 3, H, W) with noise, which is the same in all colours."""
    return light * (1 + NOISE * torch.randn(light[:, :1].shape, generator=torch.Generator().manual_seed(0)))


def error(picture: torch.Tensor, light: torch.Tensor) -> float:
    return float((picture - light).square().mean().sqrt())


def test_what_is_as_estimated_loses_its_noise(surface):
    light = torch.rand(1, 3, SIZE, SIZE, generator=torch.Generator().manual_seed(1))
    assert error(without_noise(traced(light), light, surface), light) < 0.2 * error(traced(light), light)


def test_what_the_estimate_lacks_is_found_up_to_the_edge_of_a_surface(surface):
    estimate = torch.ones(1, 3, SIZE, SIZE)
    light = estimate.clone()
    light[..., EDGE:] = 2
    found = without_noise(traced(light), estimate, surface)
    assert error(found, light) < 0.3 * error(traced(light), light)
    for column, expected in ((EDGE - 1, 1), (EDGE, 2)):
        assert found[..., column].mean() == pytest.approx(expected, rel=0.1)


def test_light_without_noise_stays_where_an_estimate_has_a_shadow_in_the_wrong_place(surface):
    light, estimate = torch.ones(2, 1, 3, SIZE, SIZE)
    light[..., 20:24, :], estimate[..., 22:26, :] = 0, 0
    assert error(without_noise(light, estimate, surface), light) < 0.05 * error(estimate, light)


def test_bands_make_no_difference(surface, monkeypatch):
    light = torch.ones(1, 3, SIZE, SIZE)
    whole = without_noise(traced(light), 0.5 * light, surface)
    monkeypatch.setattr(traced_noise, "BAND_PIXELS", SIZE * 16)
    torch.testing.assert_close(without_noise(traced(light), 0.5 * light, surface), whole)
