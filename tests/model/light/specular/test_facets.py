# SPDX-License-Identifier: GPL-3.0-or-later
"""Facets of rough glass, and the lobe that stands for all of them where light leaves it."""
import numpy as np
import pytest

from renderformer_v2.model.geometry import dot, refracted
from renderformer_v2.model.light.specular.facets import exit_lobe, pixel_starts, rough_facets
from renderformer_v2.model.material.reflectance import fresnel

COUNT = 20_000


def leaving(degrees: float, roughness: float, ior: float) -> tuple[float, float, float, float]:
    """Median turn off the axis of the lobe and share of light that leaves, of facets, and of `exit_lobe`."""
    ray = np.repeat([(np.sin(np.radians(degrees)), 0, np.cos(np.radians(degrees)))], COUNT, 0)
    normal, iors = np.repeat([(0.0, 0.0, -1.0)], COUNT, 0), np.full(COUNT, ior)
    start = np.random.default_rng(0).random((COUNT, 2)).astype(np.float32)
    facets = rough_facets(ray, normal, np.full(COUNT, roughness), start, 0)
    out = refracted(ray, facets, iors, np.ones(COUNT, bool))
    leaves = out[:, 2] > 0
    axis, spread, share = (x[0] for x in exit_lobe(ray, normal, np.full(COUNT, roughness), iors))
    turn = np.median(np.arccos(np.clip(out[leaves] @ axis, -1, 1)))
    passed = leaves * (1 - fresnel(-dot(ray, facets), 1 / iors))
    return turn, passed.mean(), 2 * np.arctan(spread ** 2), share


@pytest.mark.parametrize("degrees", [0, 20])
@pytest.mark.parametrize(("roughness", "ior"), [(0.2, 1.5), (0.4, 1.5), (0.5, 1.2), (0.6, 1.5)])
def test_the_lobe_is_as_wide_and_as_bright_as_facets_make_it(degrees, roughness, ior):
    turn, passed, lobe_turn, share = leaving(degrees, roughness, ior)
    assert lobe_turn == pytest.approx(turn, rel=0.4)
    assert share == pytest.approx(passed, abs=0.15)


def test_light_that_stays_inside_and_smooth_glass_have_no_lobe():
    ray, normal = np.float64([(0.9, 0, np.sqrt(0.19)), (0, 0, 1)]), np.float64([(0, 0, -1)] * 2)
    share = exit_lobe(ray, normal, np.array([0.3, 0.1]), np.full(2, 1.5))[2]
    assert not share.any()


def test_neighbours_choose_facets_all_over_the_lobe():
    rows, columns = (x.ravel() for x in np.mgrid[:8, :8])
    start = pixel_starts(rows, columns)
    cells = np.unique((4 * start).astype(int) @ (4, 1))
    assert len(cells) == 16 and start.min() >= 0 and start.max() < 1


def test_smooth_surfaces_have_no_facets():
    normal = np.float32([(0, 0, -1)])
    ray = np.float64([(0, 0.6, 0.8)])
    np.testing.assert_array_equal(rough_facets(ray, normal, np.array([0.1]), np.float32([(0.3, 0.7)]), 0), normal)
