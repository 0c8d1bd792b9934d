# SPDX-License-Identifier: GPL-3.0-or-later
"""Light through panes; how close a room with a window is to Cycles, tests/rf2_engine/frame asks."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.light.bounce.panes import MIRRORED, Panes, transmittance_at
from renderformer_v2.model.scene import IOR, TRANSMISSION
from tests.model.samples import flat

MEANS = torch.tensor([0.535, 0.7, 0.8, 0.97])


def test_of_light_from_everywhere_glass_lets_about_as_much_pass_as_was_measured():
    cosine = (torch.arange(1000) + 0.5) / 1000
    passing = transmittance_at(cosine[:, None].expand(-1, 4), MEANS.expand(1000, 4))
    torch.testing.assert_close((2 * cosine[:, None] * passing).mean(0), MEANS, atol=0.05, rtol=0)


@pytest.mark.parametrize("cosine, expected", [(1.0, 0.744), (0.766, 0.577), (0.574, 0.391)])
def test_a_pane_is_clearer_straight_on_than_at_a_slant(cosine, expected):
    """Measured in Cycles through a hole in a black wall before a pane of IOR 1.45; here both sides at once."""
    into, out = torch.tensor(0.9), torch.tensor(0.535 / 0.9)
    both = transmittance_at(torch.tensor(cosine), into) * transmittance_at(torch.tensor(cosine), out)
    assert float(both) == pytest.approx(expected, abs=0.04)


def test_rays_that_see_the_sky_through_glass_see_what_it_mirrors_too():
    pane = flat(np.float32([[(-1, -1, 0), (1, -1, 0), (0, 1, 0)]]), (1, 1, 1))
    pane.tiles[:, TRANSMISSION], pane.tiles[:, IOR] = 1, 1.45
    panes = Panes(pane, None, torch.device("cpu"))
    origin = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [5.0, 0.0, 1.0]])
    slanting = torch.tensor([0.28, 0.0, -0.96])
    glass = panes.behind(origin, slanting.expand(3, 3), torch.tensor([torch.inf, 3.0, torch.inf]))
    assert glass.ray.tolist() == [0, 1] and glass.mirroring.tolist() == [0]  # a wall is behind, beside the pane
    torch.testing.assert_close(glass.onward, torch.tensor([[0.28, 0.0, 0.96]]))
    torch.testing.assert_close(glass.begin, torch.tensor([[0.28 / 0.96, 0.0, 0.0]]), atol=1e-3, rtol=0)
    torch.testing.assert_close(glass.mirrored, MIRRORED * (1 - glass.transmittance[:1, :1]), atol=1e-6, rtol=0)
