# SPDX-License-Identifier: GPL-3.0-or-later
"""Quartered triangles cover the same surface, and what hits one is found in the right piece."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.geometry import area_vectors, barycentric
from renderformer_v2.model.light.bounce import subdivision
from renderformer_v2.model.light.bounce.slices import slice_counts
from renderformer_v2.model.light.bounce.subdivision import DEEPEST, Subdivision

TRIANGLES = np.random.default_rng(0).random((6, 3, 3)).astype(np.float32)
ROWS = np.array([0, 1, 3, 4])


def quartered(times: int, slices: tuple[int, ...] = (1, 1, 1, 1)) -> Subdivision:
    made, rng = Subdivision(TRIANGLES, ROWS), np.random.default_rng(1)
    made.slice(np.array(slices))
    for _ in range(times):
        made.quarter(rng.choice(len(made.corners), 2, replace=False))
    return made


@pytest.mark.parametrize("slices", [(1, 1, 1, 1), (5, 1, 2, 7)])
def test_pieces_cover_their_triangles(slices):
    corners, source = quartered(30, slices).pieces()
    area = np.linalg.norm(area_vectors(corners), axis=1)
    np.testing.assert_allclose(np.bincount(source, area, minlength=6)[ROWS],
                               np.linalg.norm(area_vectors(TRIANGLES[ROWS]), axis=1), rtol=1e-5)


@pytest.mark.parametrize("slices", [(1, 1, 1, 1), (5, 1, 2, 7)])
def test_the_piece_is_found_that_a_point_lies_in(slices):
    made, rng = quartered(40, slices), np.random.default_rng(2)
    corners, source = made.pieces()
    weights = rng.dirichlet((1, 1, 1), 5000).astype(np.float32)
    triangle = rng.choice([-1, 0, 1, 2, 3, 4, 5], 5000)
    piece = made.locator().find(torch.from_numpy(triangle).int(), torch.from_numpy(weights[:, :2])).numpy()
    is_part = np.isin(triangle, ROWS)
    assert (piece[~is_part] == len(corners)).all() and (source[piece[is_part]] == triangle[is_part]).all()
    point = np.einsum("pk,pkc->pc", weights[is_part], TRIANGLES[triangle[is_part]])
    assert barycentric(corners[piece[is_part]], point).min() > -1e-3


def test_values_are_interpolated_in_slices():
    made = quartered(20, (3, 4, 1, 2))
    np.testing.assert_allclose(made.interpolated(TRIANGLES), made.pieces()[0], atol=1e-5)
    flat = np.roll(TRIANGLES, 1, axis=0)
    towards = area_vectors(made.pieces()[0]) * area_vectors(TRIANGLES)[made.pieces()[1]]
    assert (towards.sum(1) > 0).all() and not made.heights(np.ones_like(flat)).isnan().any()


def test_needles_are_cut_across_and_other_triangles_are_not():
    needle = np.float32([(0, 0, 0), (8, 0, 0), (8, 0.1, 0)])
    triangles = np.stack([needle, np.float32([(0, 0, 1), (8, 0, 1), (0, 8, 1)]), needle * (0.01, 0.01, 1)])
    size = np.linalg.norm(area_vectors(triangles), axis=1)
    counts = slice_counts(triangles, size, np.ones(3), 1000)
    assert counts[0] > 15 and counts[1] == 1 and counts[2] < 5
    made = Subdivision(triangles, np.arange(3))
    made.slice(counts)
    sides = made.corners[np.array(made.source) == 0]
    assert np.linalg.norm(sides - np.roll(sides, 1, axis=1), axis=-1).max() < 0.6
    assert slice_counts(triangles, size, np.ones(3), 100)[0] < counts[0]


def test_nothing_is_quartered_for_ever():
    made = Subdivision(TRIANGLES, ROWS[:1])
    for _ in range(DEEPEST + 3):
        made.quarter(np.array([len(made.corners) - 1]))
    assert len(made.corners) == 1 + 3 * DEEPEST


def test_of_many_triangles_the_largest_may_be_quartered(monkeypatch):
    monkeypatch.setattr(subdivision, "CANDIDATES", 2)
    made = Subdivision(TRIANGLES * np.float32([1, 2, 3, 4, 5, 6])[:, None, None], np.arange(6))
    assert set(made.source) <= {3, 4, 5} and len(made.corners) == 2 and len(made.whole) == 4
    found = made.locator().find(torch.arange(6), torch.full((6, 2), 1 / 3))
    assert (made.pieces()[1][found.numpy()] == np.arange(6)).all()
