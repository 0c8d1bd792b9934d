# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels hear their own ray bundle, whichever rows of them are asked for."""
import pytest
import torch

from renderformer_v2.model.guided.bundle_decoder import BundleDecoder
from renderformer_v2.model.weights.presets import rf2_small

CONFIG = rf2_small()
PATCH = CONFIG.patch_size


@pytest.fixture(scope="module")
def decoder() -> BundleDecoder:
    torch.manual_seed(0)
    return BundleDecoder(CONFIG, 5).requires_grad_(False)


@pytest.fixture(scope="module")
def features() -> torch.Tensor:
    torch.manual_seed(1)
    return torch.randn(2, CONFIG.latent_dim, 3, 4)


@pytest.mark.parametrize("rows", [slice(0, 24), slice(0, 8), slice(6, 14), slice(9, 24)])
def test_some_rows_are_those_of_the_whole(decoder, features, rows):
    whole = decoder(features, slice(0, 3 * PATCH))
    assert whole.shape == (2, 5, 3 * PATCH, 4 * PATCH) and whole.std() > 0.1
    torch.testing.assert_close(decoder(features, rows), whole[..., rows, :])


def test_what_one_bundle_says_reaches_its_own_pixels_alone(decoder, features):
    changed = features.clone()
    changed[0, :, 1, 2] += torch.arange(CONFIG.latent_dim)
    differs = (decoder(changed, slice(0, 24)) != decoder(features, slice(0, 24))).any(1)
    expected = torch.zeros(2, 3, 4, dtype=torch.bool)
    expected[0, 1, 2] = True
    assert torch.equal(differs, expected.repeat_interleave(PATCH, 1).repeat_interleave(PATCH, 2))


def test_louder_features_say_the_same(decoder, features):
    whole = slice(0, 24)
    torch.testing.assert_close(decoder(1e4 * features, whole), decoder(features, whole), atol=1e-4, rtol=1e-4)
