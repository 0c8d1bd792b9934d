# SPDX-License-Identifier: GPL-3.0-or-later
"""How many samples pixels have, by what Cycles says of them."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.sampling import Sampling


@pytest.mark.parametrize("most, share, counts", [
    (64, [0.25, 0.5, 1.0], [16, 32, 64]),
    (64, [1 / 3, 1.0], [16, 48]),   # the session ended early
    (64, [0.5, 1.0], [16, 32]),     # or after 64, which would be less noise
    (64, [1.0, 1.0], [16, 16]),
    (40, [0.4, 0.8, 1.0], [16, 32, 40]),
    (100, [0.16, 0.96, 1.0], [16, 96, 100]),
])
def test_samples_follow_from_the_shares_that_cycles_gives(most, share, counts):
    np.testing.assert_allclose(Sampling(most, 0.1).counts(np.float32([share])), [counts], rtol=1e-3)


@pytest.mark.parametrize("sampling", [Sampling(64), Sampling(12, 0.1), Sampling(64, 0.1).fixed])
def test_without_a_threshold_or_with_few_samples_all_pixels_have_as_many(sampling):
    assert not sampling.is_adaptive and sampling.counts(np.ones((2, 2))) == sampling.most


def test_noise_counts_by_how_bright_the_picture_is_exposed():
    dark, bright = (Sampling(64, 0.1).cycles_settings(e)["cycles.adaptive_threshold"] for e in (0.25, 4.0))
    assert (dark, bright) == pytest.approx((0.2, 0.05))
