# SPDX-License-Identifier: GPL-3.0-or-later
"""The refiner starts with no say, sees some way around, and is the same in bands."""
import pytest
import torch

from renderformer_v2.model.guided import refiner as refiner_module
from renderformer_v2.model.guided.refiner import COARSEST, REACH, Refiner


@pytest.fixture
def refiner():
    torch.manual_seed(0)
    module = Refiner(5, 4, 3)
    torch.nn.init.normal_(module.leave.weight)
    return module.eval()


def test_an_untrained_refiner_changes_nothing():
    assert (Refiner(5, 4, 3)(torch.randn(1, 5, 64, 64)) == 0).all()


@torch.no_grad()
def test_bands_of_a_large_picture_change_nothing(refiner, monkeypatch):
    x = torch.randn(2, 5, 6 * REACH, 16)
    whole = refiner(x[:, :2], x[:, 2:])
    monkeypatch.setattr(refiner_module, "BAND_PIXELS", 1)
    torch.testing.assert_close(refiner(x), whole)


def test_a_pixel_looks_no_farther_than_said(refiner):
    side = 2 * REACH + COARSEST
    x = torch.randn(1, 5, side, side, requires_grad=True)
    middle = side // 2
    refiner(x)[..., middle, middle].sum().backward()
    rows = x.grad.abs().sum((0, 1, 3)).nonzero()[:, 0]
    assert middle - REACH <= rows.min() < middle - 4 * COARSEST and middle + 4 * COARSEST < rows.max() < middle + REACH
