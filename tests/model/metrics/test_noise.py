# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise of a reference is told from a wrong picture of it."""
import numpy as np
import pytest

from renderformer_v2.model.metrics.scores import excess_noise

SIGMA = 0.05


@pytest.fixture
def scene():
    """(96, 128, 3): a gradient with a checkerboard texture in one half and an edge."""
    y, x = np.mgrid[:96, :128] / 96
    picture = 0.3 + 0.3 * x + 0.1 * np.sin(3 * y)
    picture[:, 64:] += 0.1 * ((np.indices((96, 64)) // 3).sum(0) % 2)
    picture[40:70, 20:50] -= 0.25
    return np.repeat(picture[..., None], 3, -1).astype(np.float32)


def noisy(picture, sigma=SIGMA):
    return picture + np.random.default_rng(3).normal(0, sigma, picture.shape).astype(np.float32)


def smoothed(picture):
    return (np.roll(picture, 1, 1) + 2 * picture + np.roll(picture, -1, 1)) / 4


def test_noise_of_the_reference_is_measured_whatever_else_is_wrong(scene):
    brighter = scene * 1.1
    assert excess_noise(brighter, noisy(scene)) == pytest.approx(SIGMA ** 2, rel=0.25)


def test_only_what_the_reference_has_more_counts(scene):
    assert excess_noise(noisy(scene), scene) == 0
    assert excess_noise(noisy(scene), noisy(scene)) == 0


def test_a_smoothed_edge_is_no_noise_of_the_other_picture(scene):
    plain = scene[:, :64]
    assert excess_noise(smoothed(plain), plain) < 0.02 * np.mean((smoothed(plain) - plain) ** 2)


def test_a_picture_that_is_too_small_tells_nothing(scene):
    assert excess_noise(scene[:20, :20], noisy(scene)[:20, :20]) == 0
