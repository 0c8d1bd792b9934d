# SPDX-License-Identifier: GPL-3.0-or-later
"""Quartered triangles cover the same surface, and what hits one is found in the right piece."""
import numpy as np
import torch

from renderformer_v2.model.geometry import area_vectors, barycentric
from renderformer_v2.model.light.bounce import subdivision
from renderformer_v2.model.light.bounce.subdivision import DEEPEST, Subdivision

TRIANGLES = np.random.default_rng(0).random((6, 3, 3)).astype(np.float32)
ROWS = np.array([0, 1, 3, 4])


def quartered(times: int) -> Subdivision:
    made, rng = Subdivision(TRIANGLES, ROWS), np.random.default_rng(1)
    for _ in range(times):
        made.quarter(rng.choice(len(made.corners), 2, replace=False))
    return made


def test_pieces_cover_their_triangles():
    corners, source = quartered(30).pieces()
    area = np.linalg.norm(area_vectors(corners), axis=1)
    np.testing.assert_allclose(np.bincount(source, area, minlength=6)[ROWS],
                               np.linalg.norm(area_vectors(TRIANGLES[ROWS]), axis=1), rtol=1e-5)


def test_the_piece_is_found_that_a_point_lies_in():
    made, rng = quartered(40), np.random.default_rng(2)
    corners, source = made.pieces()
    weights = rng.dirichlet((1, 1, 1), 5000).astype(np.float32)
    triangle = rng.choice([-1, 0, 1, 2, 3, 4, 5], 5000)
    piece = made.locator().find(torch.from_numpy(triangle), torch.from_numpy(weights[:, :2])).numpy()
    is_part = np.isin(triangle, ROWS)
    assert (piece[~is_part] == len(corners)).all() and (source[piece[is_part]] == triangle[is_part]).all()
    point = np.einsum("pk,pkc->pc", weights[is_part], TRIANGLES[triangle[is_part]])
    assert barycentric(corners[piece[is_part]], point).min() > -1e-3


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
