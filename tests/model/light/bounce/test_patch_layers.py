# SPDX-License-Identifier: GPL-3.0-or-later
"""Dielectric layers let less diffuse light out at grazing angles."""
import pytest
import torch

from renderformer_v2.model.light.bounce.patch_layers import PatchLayers

COSINE = (torch.arange(64) + 0.5) / 64


def factors(f0: float, roughness: float, diffuse: float) -> torch.Tensor:
    layers = PatchLayers(*(torch.tensor([x]) for x in (f0, roughness, diffuse)))
    return layers.factor(torch.zeros(64, dtype=torch.long), COSINE)


@pytest.mark.parametrize("roughness", [0.1, 0.5, 0.9])
def test_as_much_leaves_in_all_as_without_the_angle(roughness):
    mean = (factors(0.04, roughness, 1.0) * COSINE).sum() / COSINE.sum()
    assert mean.item() == pytest.approx(1, abs=5e-3)


def test_smooth_layers_hold_back_more_at_grazing_angles_than_rough_ones():
    smooth, rough = factors(0.04, 0.1, 1.0), factors(0.04, 0.9, 1.0)
    assert smooth[0] < 0.5 < 0.8 < rough[0] < 1 < smooth[-1]
    assert (smooth.diff() > -1e-3).all()


def test_only_the_diffuse_part_turns_and_nothing_behind_the_last_side_does():
    half, whole = (factors(0.04, 0.3, share) - 1 for share in (0.5, 1.0))
    torch.testing.assert_close(half, whole / 2)
    layers = PatchLayers(*torch.full((3, 2), 0.04))
    assert (layers.factor(torch.tensor([2, 2]), torch.tensor([0.0, 1.0])) == 1).all()
