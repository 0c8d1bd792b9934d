# SPDX-License-Identifier: GPL-3.0-or-later
"""What a sheen sends on; how close that is to Cycles, tests/rf2_engine/frame/test_sheen.py asks."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.light.direct.form_factors import sheen_form_factor
from renderformer_v2.model.material.sheen import albedo, mean_albedo, stretch

ROUGHNESS = 0.2, 0.5, 1.0


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_it_is_brightest_at_silhouettes_and_never_brighter_than_its_light(roughness):
    seen = albedo(np.linspace(0.05, 1, 20, dtype=np.float32), np.float32(roughness))
    assert (np.diff(seen) < 0).all() and seen[0] < 1 and seen[-1] > 0


def test_the_rougher_the_more_it_sends_on():
    mean = mean_albedo(np.float32(ROUGHNESS)[:, None])[:, 0]
    assert (np.diff(mean) > 0.05).all() and mean[-1] < 0.5


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_of_light_from_everywhere_white_sheen_sends_on_all(roughness):
    cosine = (torch.arange(4000) + 0.5) / 4000  # rings of as many small emitters on the hemisphere
    size = torch.tensor(1e-6)
    share = sheen_form_factor(cosine, size, stretch(torch.tensor(roughness)))
    assert float(share.mean() * 2 / size) == pytest.approx(1, abs=0.01)


def test_smooth_sheen_sends_on_light_that_grazes_it():
    from_above, grazing = sheen_form_factor(torch.tensor([1.0, 0.3]), torch.tensor(1e-4), stretch(torch.tensor(0.4)))
    assert grazing > 2 * from_above
