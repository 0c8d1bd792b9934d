# SPDX-License-Identifier: GPL-3.0-or-later
"""Glossy light of patches: as much as matte patches would send, in other directions."""
import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.light.bounce.patch_lobes import PatchLobes

UP = torch.tensor([[0.0, 0.0, 1.0]])


def lobe(slope: float, concentration: float = 1.0, f0: float = 0.04, roughness: float = 0.7) -> PatchLobes:
    """Of a floor, of light that comes from +x; slope: its height over its distance."""
    toward = concentration * F.normalize(torch.tensor([[1.0, 0.0, slope]]), dim=-1)
    return PatchLobes(UP, toward, torch.tensor([f0]), torch.tensor([roughness]))


def excess(lobes: PatchLobes, leaving: torch.Tensor) -> torch.Tensor:
    """(N,) towards unit vectors (N, 3)."""
    return lobes.excess(torch.zeros(len(leaving), dtype=torch.long), -leaving.T)


@pytest.mark.parametrize("roughness", [0.67, 1.0])
@pytest.mark.parametrize("f0", [0.04, 1.0])
@pytest.mark.parametrize("slope", [0.5, 3.0])
def test_no_light_is_lost_or_added(slope, f0, roughness):
    leaving = F.normalize(torch.randn(100_000, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    leaving[:, 2] = leaving[:, 2].abs()
    changed = 2 * (leaving[:, 2] * excess(lobe(slope, f0=f0, roughness=roughness), leaving)).mean()
    assert changed.abs() < 0.02


def test_more_goes_on_than_comes_back():
    on, back = excess(lobe(0.5), F.normalize(torch.tensor([[-1.0, 0.0, 0.5], [1.0, 0.0, 0.5]]), dim=-1))
    assert on > 1 and -1 < back < -0.5


def test_light_from_all_sides_leaves_to_all_sides():
    assert excess(lobe(0.5, concentration=0.0), UP) == 0


def test_what_is_behind_all_patches_sends_nothing_more():
    assert lobe(0.5).excess(torch.tensor([1]), UP.T) == 0
