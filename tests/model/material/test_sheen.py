# SPDX-License-Identifier: GPL-3.0-or-later
"""What a sheen sends on; how close that is to Cycles, tests/rf2_engine/frame/test_sheen.py asks."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.light.direct.form_factors import sheen_form_factor
from renderformer_v2.model.material.sheen import albedo, lean, mean_albedo, stretch

ROUGHNESS = 0.2, 0.5, 1.0


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_it_is_brightest_at_silhouettes_and_never_brighter_than_its_light(roughness):
    seen = albedo(np.linspace(0.05, 1, 20, dtype=np.float32), np.float32(roughness))
    assert (np.diff(seen) < 0).all() and seen[0] < 1 and seen[-1] > 0


def test_the_rougher_the_more_it_sends_on():
    mean = mean_albedo(np.float32(ROUGHNESS)[:, None])[:, 0]
    assert (np.diff(mean) > 0.05).all() and mean[-1] < 0.5


def sent_on(cosine, turn, roughness, seen_at=0.5, size=1e-6):
    """(N,) share of small emitters' light, at cosines (N,) to the normal and turned about it from the viewer's side."""
    roughness, seen_at = torch.tensor([[roughness]]), torch.tensor([[seen_at]])
    sine = (1 - cosine ** 2).sqrt()
    direction = torch.stack([sine * torch.cos(turn), sine * torch.sin(turn), cosine])[:, None]
    aside = lean(roughness, seen_at) * torch.tensor([[1.0, 0, 0]])
    return sheen_form_factor(cosine[None], torch.tensor(size), stretch(roughness, seen_at), aside, direction)[0] / size


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_of_light_from_everywhere_white_sheen_sends_on_all(roughness):
    cosine = (torch.arange(4000) + 0.5) / 4000  # of as many places on the hemisphere, in a spiral
    assert float(sent_on(cosine, torch.arange(4000) * 2.4, roughness).mean() * 2) == pytest.approx(1, abs=0.01)


def test_smooth_sheen_sends_on_light_that_grazes_it():
    from_above, grazing = sent_on(torch.tensor([1.0, 0.3]), torch.tensor(np.pi / 2), 0.4)
    assert grazing > 2 * from_above


@pytest.mark.parametrize("roughness, seen_at, stretched, leaning", [
    (0.3, 0.2, 0.233, -0.024), (0.5, 0.2, 0.385, -0.111), (0.5, 0.55, 0.481, -0.046), (0.5, 0.94, 0.552, -0.029),
    (0.7, 0.37, 0.628, -0.095), (1.0, 0.98, 0.880, 0)])
def test_its_lobe_depends_on_where_it_is_seen_from_as_in_cycles(roughness, seen_at, stretched, leaning):
    """As suns from nine sides show of a Sheen BSDF."""
    values = np.float32(roughness), np.float32(seen_at)
    assert stretch(*values) == pytest.approx(stretched, rel=0.05)
    assert lean(*values) == pytest.approx(leaning, abs=0.03)


def test_light_from_the_viewers_side_is_sent_on_more():
    behind, before = sent_on(torch.tensor([0.7, 0.7]), torch.tensor([np.pi, 0]), 0.5, seen_at=0.37)
    assert before > 1.1 * behind
