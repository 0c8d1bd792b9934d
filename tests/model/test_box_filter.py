# SPDX-License-Identifier: GPL-3.0-or-later
"""Squares around pixels, and what of them lies outside."""
import numpy as np
import pytest

from renderformer_v2.model.pictures import box_means, box_sums


@pytest.mark.parametrize("shape", [(7, 9), (7, 9, 3), (3, 4, 2)])
@pytest.mark.parametrize("radius", [1, 2, 4])
def test_sums_are_those_of_all_pixels_within_reach(shape, radius):
    x = np.random.default_rng(0).normal(size=shape)
    found = box_sums(x, radius)
    for i, j in np.ndindex(shape[:2]):
        square = x[max(i - radius, 0):i + radius + 1, max(j - radius, 0):j + radius + 1]
        np.testing.assert_allclose(found[i, j], square.sum(axis=(0, 1)), atol=1e-12)
        np.testing.assert_allclose(box_means(x, radius)[i, j], square.mean(axis=(0, 1)), atol=1e-12)


def test_what_is_not_finite_stays_near_its_pixel():
    x = np.ones((20, 20, 1), np.float32)
    x[5, 5] = np.inf
    found = box_sums(x, 2)
    assert found.dtype == np.float32 and np.isfinite(found[8:]).all() and np.count_nonzero(~np.isfinite(found)) == 25
