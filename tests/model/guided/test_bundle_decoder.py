# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels hear their own ray bundle and those near it, whichever rows of them are asked for."""
import pytest
import torch

from renderformer_v2.model.guided.bundle_decoder import CELLS, LARGEST_LOG, SAID, BundleDecoder, at_pixels
from renderformer_v2.model.light.edge_stopping import SIDE
from renderformer_v2.model.weights.presets import rf2_small

CONFIG = rf2_small()
PATCH = CONFIG.patch_size
ALL = slice(0, 5 * PATCH)


@pytest.fixture(scope="module")
def decoder() -> BundleDecoder:
    torch.manual_seed(0)
    decoder = BundleDecoder(CONFIG).requires_grad_(False)
    torch.nn.init.normal_(decoder.project.weight, std=0.1)
    return decoder


@pytest.fixture(scope="module")
def features() -> torch.Tensor:
    torch.manual_seed(1)
    return torch.randn(2, CONFIG.latent_dim, 5, 6)


def pixels(decoder, features, rows=ALL) -> torch.Tensor:
    return at_pixels(decoder(features), rows, 6 * PATCH, PATCH // CELLS)


def test_new_weights_leave_light_as_it_is(features):
    assert not BundleDecoder(CONFIG)(features).any()


@pytest.mark.parametrize("rows", [ALL, slice(0, 8), slice(6, 14), slice(9, 24), slice(11, 12)])
def test_some_rows_are_those_of_the_whole(decoder, features, rows):
    whole = pixels(decoder, features)
    assert whole.shape == (2, len(SAID), 5 * PATCH, 6 * PATCH) and whole.std() > 0.1
    torch.testing.assert_close(pixels(decoder, features, rows), whole[..., rows, :])


def test_what_one_bundle_says_ends_in_the_middle_of_the_cell_after_those_that_are_smoothed(decoder, features):
    changed = features.clone()
    changed[0, :, 2, 3] += torch.arange(CONFIG.latent_dim)
    differs = (pixels(decoder, changed) != pixels(decoder, features)).any(1)
    cell = PATCH // CELLS
    reach = cell * (SIDE // 2) + cell // 2
    expected = torch.zeros(2, 5 * PATCH, 6 * PATCH, dtype=torch.bool)
    expected[0, 2 * PATCH - reach:3 * PATCH + reach, 3 * PATCH - reach:4 * PATCH + reach] = True
    assert torch.equal(differs, expected)


def test_the_loudest_features_say_no_more_than_a_known_factor(decoder, features):
    torch.testing.assert_close(pixels(decoder, 1e4 * features), pixels(decoder, features), atol=1e-4, rtol=1e-4)
    torch.nn.init.constant_(decoder.project.bias, 1e4)
    factors = pixels(decoder, features)[:, SAID["log_factor"]]
    torch.testing.assert_close(factors, torch.full_like(factors, LARGEST_LOG))
