# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray bundles look at each other before they say how far they trust an estimate."""
import pytest
import torch

from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.guided.bundle_decoder import CELLS
from renderformer_v2.model.guided.fusion import Fusion

GRID, STATISTICS = (30, 20), 7


@pytest.fixture(scope="module")
def fusion() -> Fusion:
    torch.manual_seed(0)
    fusion = Fusion(STATISTICS).requires_grad_(False)
    torch.nn.init.normal_(fusion.project.weight)
    return fusion


@pytest.fixture(scope="module")
def bundles() -> tuple[torch.Tensor, torch.Tensor]:
    torch.manual_seed(1)
    return torch.randn(2, GRID[0] * GRID[1], STATISTICS), torch.rand(2, GRID[0] * GRID[1], 3)


def test_new_weights_trust_as_pixels_do(bundles):
    said = Fusion(STATISTICS)(*bundles, GRID)
    assert said.shape == (2, 1, CELLS * GRID[0], CELLS * GRID[1]) and not said.any()


def test_pieces_say_what_the_whole_says(fusion, bundles):
    whole = fusion(*bundles, GRID)
    with inference():
        torch.testing.assert_close(fusion(*bundles, GRID), whole)


def test_bundles_hear_of_each_other_the_less_the_farther_they_are_apart(fusion, bundles):
    statistics, positions = bundles
    positions = positions.clone()
    for bundle, place in enumerate((0.0, 0.05, 2.0)):
        positions[0, bundle] = place
    changed = statistics.clone()
    changed[0, 0] += 5
    differs = (fusion(changed, positions, GRID) - fusion(statistics, positions, GRID)).abs().amax(1)
    near, far = differs[0, :CELLS, CELLS:2 * CELLS].max(), differs[0, :CELLS, 2 * CELLS:3 * CELLS].max()
    assert near > far > 0 and not differs[1].any()
