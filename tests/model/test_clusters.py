# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of weighted points."""
import numpy as np

from renderformer_v2.model.clusters import split_clusters


def test_far_and_heavy_points_are_told_apart_first():
    points = np.array([[0.0], [0.1], [5.0], [5.1], [9.0]])
    groups = split_clusters(points, np.array([1.0, 1.0, 1.0, 1.0, 1e-6]), [np.arange(5)], 2)
    assert sorted(map(sorted, groups)) == [[0, 1], [2, 3, 4]]


def test_every_row_is_in_one_group_and_their_number_is_bounded():
    rng = np.random.default_rng(0)
    points, kinds = rng.standard_normal((500, 4)), [np.arange(200), np.arange(200, 500)]
    groups = split_clusters(points, rng.uniform(0, 1, 500), kinds, 32)
    assert len(groups) == 32 and sorted(np.concatenate(groups)) == list(range(500))
    assert all((rows < 200).all() or (rows >= 200).all() for rows in groups)


def test_equal_points_stay_together():
    assert len(split_clusters(np.ones((10, 3)), np.ones(10), [np.arange(10)], 4)) == 1
    assert split_clusters(np.zeros((0, 3)), np.zeros(0), [], 4) == []


def test_equal_points_stay_together_whatever_their_mean_is_rounded_to():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        groups = split_clusters(np.tile(rng.random(5), (3, 1)), rng.random(3), [np.arange(3)], 4)
        assert [sorted(rows) for rows in groups] == [[0, 1, 2]]
