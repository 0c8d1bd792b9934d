# SPDX-License-Identifier: GPL-3.0-or-later
"""Dielectric layers let less diffuse light out at grazing angles, and reflect more there."""
import pytest
import torch

from renderformer_v2.model.light.bounce.patch_layers import PatchLayers

COSINE = (torch.arange(64) + 0.5) / 64


def factors(f0: float, roughness: float, diffuse: float, even: float = 0.0) -> torch.Tensor:
    layers = PatchLayers(*(torch.tensor([x]) for x in (f0, roughness, diffuse, even)))
    return layers.factor(torch.zeros(64, dtype=torch.long), COSINE)


@pytest.mark.parametrize("roughness", [0.1, 0.5, 0.9])
def test_as_much_leaves_in_all_as_without_the_angle(roughness):
    for shares, tolerance in (((1.0, 0.0), 5e-3), ((0.0, 1.0), 3e-2)):
        mean = (factors(0.04, roughness, *shares) * COSINE).sum() / COSINE.sum()
        assert mean.item() == pytest.approx(1, abs=tolerance)


def test_smooth_layers_hold_back_more_at_grazing_angles_than_rough_ones():
    smooth, rough = factors(0.04, 0.1, 1.0), factors(0.04, 0.9, 1.0)
    assert smooth[0] < 0.5 < 0.8 < rough[0] < 1 < smooth[-1]
    assert (smooth.diff() > -1e-3).all()


def test_of_light_from_everywhere_a_layer_sends_more_there_as_blurred_as_cycles_does():
    smooth, rough = factors(0.04, 0.1, 0.0, 1.0), factors(0.04, 0.67, 0.0, 1.0)
    torch.testing.assert_close(smooth, rough, rtol=0.01, atol=0)
    assert smooth[2] > 1.5 and smooth[-1] < 1


def test_only_the_diffuse_part_turns_and_nothing_behind_the_last_side_does():
    half, whole = (factors(0.04, 0.3, share) - 1 for share in (0.5, 1.0))
    torch.testing.assert_close(half, whole / 2)
    layers = PatchLayers(*torch.full((4, 2), 0.04))
    assert (layers.factor(torch.tensor([2, 2]), torch.tensor([0.0, 1.0])) == 1).all()
