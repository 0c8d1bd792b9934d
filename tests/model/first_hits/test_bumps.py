# SPDX-License-Identifier: GPL-3.0-or-later
"""Bumps finer than a pixel widen what it mirrors, and darken what is matte."""
import numpy as np
import pytest

from renderformer_v2.model.first_hits.bumps import matte_share, normal_variance, with_bumps
from renderformer_v2.model.geometry import unit

SIZE, MIDDLE = 8, (4, 4)


def plane(normal=(0.0, 0.0, 1.0)) -> tuple[np.ndarray, np.ndarray]:
    """Positions and unit normals of pixels that look down at z = 0."""
    y, x = np.mgrid[:SIZE, :SIZE].astype(np.float32)
    return np.stack([x, y, 0 * x], -1), np.tile(np.float32(normal), (SIZE, SIZE, 1))


def test_a_pixel_is_as_rough_as_its_bumps_are_steep():
    """The mean of a few normals is longer than that of all."""
    normals = unit(np.random.default_rng(0).normal(0, (0.1, 0.1, 0), (20000, 8, 3)) + (0, 0, 1))
    short = np.sqrt(np.square(normals.mean(1)).sum(-1).mean())
    position, flat = plane()
    variance = normal_variance(short * flat, np.full((SIZE, SIZE), 8.0), position, flat)
    assert variance[MIDDLE] == pytest.approx(0.02, rel=0.05)
    np.testing.assert_allclose(with_bumps(np.full((SIZE, SIZE), 0.5), variance)[MIDDLE], 0.533, rtol=1e-2)
    assert normal_variance(flat, None, position, flat) is None


def test_the_edge_between_two_surfaces_is_no_bump():
    position, normal = plane()
    normal[:, 4:] = 0.6, 0, 0.8
    mean = normal.copy()
    mean[:, 4] = mean[:, 3] = (normal[0, 0] + normal[0, 4]) / 2
    assert normal_variance(mean, None, position, normal) is None


def test_a_wire_before_a_floor_is_no_bump():
    position, normal = plane()
    position[:, 4, 2] = 1
    mean = normal.copy()
    mean[:, 4] *= 0.8
    assert normal_variance(mean, None, position, normal) is None


def test_bumps_that_pixels_show_are_no_finer():
    position, flat = plane()
    mean = 0.99 * unit(flat + np.float32(0.3) * np.sin(2 * position[..., :1]) * np.float32((1, 0, 0)))
    shown, finer = (normal_variance(x, None, position, flat)[MIDDLE] for x in (mean, 0.99 * flat))
    assert shown < finer


def test_a_matte_pixel_sends_on_as_much_light_as_all_its_bumps():
    normals = unit(np.random.default_rng(0).normal(0, (0.4, 0.4, 0), (20000, 3)) + (0, 0, 1))
    sun = unit(np.float32((0.3, 0, 1)))
    _, flat = plane()
    mean = normals.mean(0)[2]
    share = matte_share(mean * flat, None, flat)[MIDDLE]
    assert mean < 0.9 and share == pytest.approx((normals @ sun).mean() / sun[2], rel=0.01)
    assert matte_share(flat, None, flat) is None


def test_no_light_is_lost_where_pixels_show_several_surfaces_or_none():
    _, normal = plane()
    normal[:, 4:] = 0.6, 0, 0.8
    mean = normal.copy()
    mean[:, 4] = mean[:, 3] = (normal[0, 0] + normal[0, 4]) / 2
    assert matte_share(mean, None, normal) is None
    normal[:, 4:] = 0
    mean[:, 4:] *= 0.5
    assert matte_share(mean, None, normal) is None
