# SPDX-License-Identifier: GPL-3.0-or-later
"""Millions of crumbs become thousands of patches that stand for them."""
import numpy as np

from renderformer_v2.model.geometry import area_vectors
from renderformer_v2.model.light.bounce import grouping
from renderformer_v2.model.light.bounce.grouping import group_elements, group_patches


def grid(side: int) -> np.ndarray:
    """(2 side^2, 3, 3) triangles of the unit square."""
    x, y = (g.ravel() for g in np.meshgrid(*[np.linspace(0, 1, side, endpoint=False)] * 2))
    corner, step = np.stack([x, y, 0 * x], -1)[:, None], 1 / side
    shapes = np.array([[(0, 0, 0), (step, 0, 0), (0, step, 0)], [(step, step, 0), (0, step, 0), (step, 0, 0)]])
    return np.concatenate([corner + shape for shape in shapes]).astype(np.float32)


def test_few_triangles_are_elements_of_their_own():
    element, largest = group_elements(grid(8), np.zeros(128, int), np.ones(1))
    assert (element == np.arange(128)).all() and (largest == np.arange(128)).all()


def test_elements_are_of_one_token_and_cell_and_named_by_their_largest_triangle(monkeypatch):
    monkeypatch.setattr(grouping, "MANY", 100)
    corners = grid(64)
    corners[5] *= 1.001  # the largest of all
    token = (corners.mean(axis=1)[:, 0] > 0.5).astype(int)
    element, largest = group_elements(corners, token, np.full(2, 0.01))
    assert len(largest) < len(corners) / 8 and largest[element[5]] == 5
    assert (token[largest][element] == token).all()
    middle = corners.mean(axis=1)
    assert np.linalg.norm(middle - middle[largest][element], axis=1).max() < 2 * grouping.FINEST * 0.01 ** -0.5


def test_many_small_objects_leave_room_for_the_floor_that_they_lie_on():
    """They share patches with each other before the floor's become coarse."""
    floor, thing = grid(32), grid(4) * 0.01
    places = np.random.default_rng(0).random((300, 1, 1, 3)) * (1, 1, 0) + (0, 0, 0.1)
    things = (thing + places).reshape(-1, 3, 3)
    corners = np.concatenate([floor, things]).astype(np.float32)
    surface = np.concatenate([np.zeros(len(floor), int), 1 + np.repeat(np.arange(300), len(thing))])
    alike = np.zeros(len(corners), np.int64)
    group, count = group_patches(corners.mean(axis=1), area_vectors(corners), alike > 0, alike, surface,
                                 np.full(len(corners), 0.08), 1024)
    assert count <= 1024 and len(np.unique(group[:len(floor)])) > 100
    assert not np.isin(group[len(floor):], group[:len(floor)]).any()
