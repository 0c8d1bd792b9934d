# SPDX-License-Identifier: GPL-3.0-or-later
"""Some of many things stand for all of them."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.meshes.sampling import keep_sample


@pytest.fixture
def area():
    return np.random.default_rng(0).uniform(1, 3, 5000)


@pytest.mark.parametrize("with_places", [False, True])
def test_they_have_the_area_of_all_and_cost_what_there_is_room_for(area, with_places):
    places = np.random.default_rng(1).uniform(size=(5000, 3)) if with_places else None
    cost = np.random.default_rng(2).integers(1, 5, 5000)
    kept, growth = keep_sample(area, 2000, cost=cost, positions=places)
    assert cost[kept].sum() == pytest.approx(2000, rel=0.05)
    assert (area * growth ** 2)[kept].sum() == pytest.approx(area.sum(), rel=0.02)


def test_what_is_large_is_kept_as_it_is(area):
    area[::1000] = 5000
    kept, growth = keep_sample(area, 500)
    assert kept[::1000].all() and (growth[::1000] == 1).all() and np.count_nonzero(kept) == pytest.approx(500, abs=1)
    assert (area * growth ** 2)[kept].sum() == pytest.approx(area.sum(), rel=0.02)


def test_those_for_which_there_is_room_are_all_kept(area):
    kept, growth = keep_sample(area, 5000)
    assert kept.all() and (growth == 1).all()


@pytest.mark.parametrize("places", [None, np.zeros((0, 3))])
def test_of_nothing_nothing_is_kept(places):
    kept, growth = keep_sample(np.zeros(0), 10, positions=places, sizes=np.zeros(0))
    assert len(kept) == len(growth) == 0


def test_they_are_spread_evenly_through_space():
    places = np.random.default_rng(3).uniform(size=(8000, 3))
    kept, _ = keep_sample(np.ones(8000), 800, positions=places)
    counts = np.histogramdd(places[kept], bins=2)[0]
    np.testing.assert_allclose(counts, 100, atol=12)


def test_in_their_own_order_the_same_are_kept_wherever_they_go():
    kept, _ = keep_sample(np.ones(950), 100)
    assert np.count_nonzero(kept) == 100 and set(np.diff(np.flatnonzero(kept))) == {9, 10}
