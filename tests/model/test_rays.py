# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against rays that look at every triangle."""
import sys

import numpy as np
import pytest

from renderformer_v2.model import progress, rays
from renderformer_v2.model.compute.threads import limited
from renderformer_v2.model.errors import RenderCancelled
from renderformer_v2.model.rays import EmbreeCaster, Rays

SQUARE = np.float32([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]])
rng = np.random.default_rng(0)


def clutter(count: int) -> np.ndarray:
    """(count, 3, 3) small triangles in a box of side 2."""
    return np.float32(rng.uniform(-1, 1, (count, 1, 3)) + rng.normal(0, 0.1, (count, 3, 3)))


def some(count: int) -> tuple[np.ndarray, np.ndarray]:
    direction = rng.normal(size=(count, 3))
    return rng.uniform(-1, 1, (count, 3)), direction / np.linalg.norm(direction, axis=1, keepdims=True)


def by_looking_at_all(triangles, origin, direction) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangle (P,), distance (P,) and weights (P, 2) of what is met first (Moeller and Trumbore 1997)."""
    a, u, v = (x.astype(np.float64)[None] for x in (triangles[:, 0], triangles[:, 1] - triangles[:, 0],
                                                    triangles[:, 2] - triangles[:, 0]))
    across = np.cross(direction[:, None], v)
    scale = (u * across).sum(-1)
    away = origin[:, None] - a
    s, aside = (away * across).sum(-1) / scale, np.cross(away, u)
    t, at = (direction[:, None] * aside).sum(-1) / scale, (v * aside).sum(-1) / scale
    at = np.where((s >= 0) & (t >= 0) & (s + t <= 1) & (at > 0), at, np.inf)
    first, rows = at.argmin(1), np.arange(len(origin))
    nothing = np.isinf(at[rows, first])
    return (np.where(nothing, -1, first), at[rows, first],
            np.where(nothing[:, None], 0, np.stack([1 - s - t, s], -1)[rows, first]))


def test_rays_meet_what_lies_first_on_their_way():
    triangles, (origin, direction) = clutter(300), some(4000)
    triangle, distance, weights = by_looking_at_all(triangles, origin, direction)
    met = Rays(triangles).closest(origin, direction)
    assert 0.2 < (triangle >= 0).mean() < 0.95
    same = met.triangle == triangle
    assert same.mean() > 0.999  # the rest passes an edge
    np.testing.assert_allclose(met.distance[same], distance[same], rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(met.weights[same], weights[same], atol=2e-3)


def test_what_stands_within_a_distance_blocks():
    triangles, (origin, direction) = clutter(300), some(4000)
    distance = by_looking_at_all(triangles, origin, direction)[1]
    reach = rng.uniform(0, 1, len(origin))
    assert (Rays(triangles).blocked(origin, direction, reach) == (distance < reach)).mean() > 0.999
    assert (Rays(triangles).blocked(origin, direction) == np.isfinite(distance)).mean() > 0.999
    assert not Rays(triangles).blocked(origin, direction, np.minimum(reach - 1, 0)).any()  # ends behind their start


def test_lengths_are_those_of_the_direction_and_both_sides_are_met():
    met = Rays(SQUARE).closest(np.float32([(0.2, 0.1, 4), (0.2, 0.1, -4)]), np.float32([(0, 0, -2), (0, 0, 0.5)]))
    np.testing.assert_allclose(met.distance, [2, 8], rtol=1e-5)
    assert Rays(SQUARE).blocked(np.float32([(0.2, 0.1, 4)] * 2), np.float32([(0, 0, -2)] * 2), np.float32([1.9, 2.1])
                                ).tolist() == [False, True]


def test_rays_may_start_at_one_point():
    met = Rays(SQUARE).closest(np.float32((0.2, 0.1, 4)), np.float32([(0, 0, -1), (0, 0, 1)]))
    assert met.triangle.tolist() in ([0, -1], [1, -1])


def test_nothing_is_met_where_there_is_nothing():
    origin, direction = some(5)
    empty = Rays(np.zeros((0, 3, 3), np.float32))
    assert (empty.closest(origin, direction).triangle == -1).all() and not empty.blocked(origin, direction).any()
    met = Rays(SQUARE).closest(np.zeros((0, 3)), np.zeros((0, 3)))
    assert [x.shape for x in met] == [(0,), (0,), (0, 2)]
    assert Rays(SQUARE).blocked(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


def test_many_rays_report_and_can_be_cancelled(monkeypatch):
    monkeypatch.setattr(rays, "CHUNK", 100)
    caster, (origin, direction) = Rays(SQUARE), some(1000)
    said = []
    with limited(1), progress.reporting(lambda text, fraction: said.append(fraction)):
        caster.closest(origin, direction)
    assert said == [pytest.approx(i / 10) for i in range(10)]

    def escape(text, fraction):
        raise RenderCancelled

    with progress.reporting(escape), pytest.raises(RenderCancelled):
        caster.blocked(origin, direction)


def test_pieces_and_threads_change_nothing(monkeypatch):
    triangles, (origin, direction) = clutter(300), some(3000)
    whole = Rays(triangles).closest(origin, direction)
    monkeypatch.setattr(rays, "CHUNK", 64)
    for a, b in zip(whole, Rays(triangles).closest(origin, direction), strict=True):
        np.testing.assert_array_equal(a, b)


def test_without_embree_its_fallback_is_asked_or_the_package_named(monkeypatch):
    monkeypatch.setattr(rays, "has_embree", lambda: False)
    monkeypatch.setattr(Rays, "fallback", None)
    origin, direction = some(5)
    with pytest.raises(ModuleNotFoundError, match="pip install embreex"):
        Rays(SQUARE).closest(origin, direction)
    made = []
    Rays.fallback = lambda triangles: made.append(triangles) or EmbreeCaster(triangles)
    asked = Rays(SQUARE)
    assert not made  # until there are rays
    asked.closest(origin, direction)
    asked.blocked(origin, direction)
    assert len(made) == 1
    np.testing.assert_array_equal(made[0], SQUARE)


def test_embree_is_found_as_soon_as_it_is_installed(monkeypatch):
    with monkeypatch.context() as before:
        before.setitem(sys.modules, "embreex.mesh_construction", None)  # as Python says of what is not there
        assert not rays.has_embree()
    assert rays.has_embree()
