# SPDX-License-Identifier: GPL-3.0-or-later
"""Highlights have the shape, size and place of their lamps, against brute-force integration."""
import math

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.direct.footprints import footprints
from renderformer_v2.model.light.fresnel import lobe_albedo
from renderformer_v2.model.light.hit_surfaces import HitSurfaces
from tests.model.light.direct.test_direct_light import lit_by

UP = np.array([0, 0, 1.0])
SQUARE = np.float32([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]])


def upright(width, low, high, x) -> np.ndarray:
    """(2, 3, 3) triangles of a rectangle across the x axis."""
    a, b, c, d = ((x, -width, low), (x, width, low), (x, width, high), (x, -width, high))
    return np.float32([(a, b, c), (a, c, d)])


def seen_at(degrees) -> np.ndarray:
    return np.array([math.sin(math.radians(degrees)), 0, math.cos(math.radians(degrees))])


def glossy(corners, degrees, roughness, f0=1.0) -> float:
    t = lambda a: torch.tensor(np.float32(a))[None]  # noqa: E731
    light = DirectLight(lit_by(corners)).lobes(t((0, 0, 0)), t(UP), t(seen_at(degrees)), t(roughness), t(f0))[1]
    return light[0, 0].item()


def integrated(corners, degrees, roughness, samples=1500) -> float:
    """Of lossless facets, over fine pieces of the triangles."""
    alpha2, v = roughness ** 4, seen_at(degrees)
    u, w = np.meshgrid(*[(np.arange(samples) + 0.5) / samples] * 2)
    u, w = np.where(u + w > 1, 1 - u, u)[..., None], np.where(u + w > 1, 1 - w, w)[..., None]
    total = 0.0
    for a, b, c in np.float64(corners):
        to = a + u * (b - a) + w * (c - a)
        d2 = (to ** 2).sum(-1)
        towards = to / np.sqrt(d2)[..., None]
        half = (towards + v) / np.linalg.norm(towards + v, axis=-1, keepdims=True)
        n_l, n_v = towards[..., 2].clip(0), v[2]
        density = alpha2 / (np.pi * (half[..., 2] ** 2 * (alpha2 - 1) + 1) ** 2)
        unmasked = 2 * n_l / (n_l * np.sqrt(alpha2 + (1 - alpha2) * n_v ** 2)
                              + n_v * np.sqrt(alpha2 + (1 - alpha2) * n_l ** 2))
        total += (density * unmasked / 4 * np.abs(towards @ np.cross(b - a, c - a)) / 2 / d2).mean()
    return total / lobe_albedo(*torch.tensor([[1.0], [v[2]], [roughness]], dtype=torch.float32)).item()


@pytest.mark.parametrize("degrees, roughness, low, high", [
    (40, 0.3, 0.5, 1.5),    # around the mirrored direction
    (40, 0.1, 1.3, 2.0),    # an edge near it
    (75, 0.2, 0.3, 1.0),    # at a slant
    (30, 0.7, -0.5, 3.0),   # of a rough surface, cut by its horizon
    (80, 0.15, -1.0, 0.3),
])
def test_a_panel_is_mirrored_where_it_is(degrees, roughness, low, high):
    panel = upright(0.6, low, high, x=-1)
    assert glossy(panel, degrees, roughness) == pytest.approx(integrated(panel, degrees, roughness), rel=0.12)


def test_a_mirror_shows_a_panel_with_straight_edges():
    """At 45 degrees the middle of the picture is at a height of 1."""
    for low, high, expected in ((0.5, 1.5, 1), (1.02, 1.5, 0), (0.5, 0.98, 0), (0.98, 1.5, 1), (0.5, 1.02, 1)):
        light = glossy(upright(3, low, high, x=-1), 45, 0.0)
        assert light == pytest.approx(expected, abs=0.05), (low, high)


def test_a_ball_is_mirrored_as_large_as_it_is():
    faces = np.float32([[(x, 0, 0), (0, y, 0), (0, 0, z)][::x * y * z] for x in (-1, 1) for y in (-1, 1)
                        for z in (-1, 1)])
    radius = math.sqrt(math.sqrt(3) / math.pi) * math.sqrt(2)  # of a sphere of this area
    for offset, expected in ((0.0, 1), (0.9, 1), (1.1, 0)):
        ball = faces * 0.1 / radius * math.sqrt(2) + np.float32((-1, offset * 0.1, 1))
        assert glossy(ball, 45, 0.0) == pytest.approx(expected, abs=0.05), offset


def highlight_on_a_ball(size: int, with_footprints: bool) -> float:
    """What a picture of this many pixels across shows of a small lamp in a ball of chrome."""
    middle = (torch.arange(size) + 0.5) * 2 / size - 1
    z, x = torch.meshgrid(-middle, middle, indexing="ij")
    is_ball = x ** 2 + z ** 2 < 0.9
    normal = torch.stack([x, -(1 - x ** 2 - z ** 2).clamp_min(0.01).sqrt(), z], -1)
    rays, zeros = torch.tensor([0.0, 1.0, 0.0]).expand_as(normal), torch.zeros(size, size)
    surfaces = HitSurfaces(rays, rays, normal, normal, is_ball[..., None].float(), *[normal] * 3, *[zeros] * 3)
    lamp = upright(0.05, 3.5, 3.6, x=-2) - np.float32((0, 2, 0))
    footprint = [footprints(surfaces).flatten(0, 1)] if with_footprints else []
    points = normal.flatten(0, 1), normal.flatten(0, 1), -rays.flatten(0, 1), zeros.flatten() + 0.1, zeros.flatten() + 1
    light = DirectLight(lit_by(lamp)).lobes(*points, None, *footprint)[1]
    return float((light[:, 0] * is_ball.flatten()).sum() / size ** 2)


def test_a_highlight_smaller_than_a_pixel_is_as_bright_as_it_should_be():
    exact = highlight_on_a_ball(1200, with_footprints=False)
    of_middles, of_pixels = (np.array([highlight_on_a_ball(size, way) for size in (47, 53, 59, 64)])
                             for way in (False, True))
    assert of_pixels.mean() == pytest.approx(exact, rel=0.2)
    assert np.abs(of_pixels - exact).mean() < 0.6 * np.abs(of_middles - exact).mean()


def test_a_facet_is_flat_up_to_its_border():
    """So no border mirrors what lies between the directions that two facets mirror."""
    size, zeros = 8, torch.zeros(8, 8)
    x = torch.linspace(-1, 1, size).expand(size, size)
    facets = torch.stack([torch.where(x < 0, -0.2, 0.2), zeros, zeros + 1], -1)
    position, rays = torch.stack([x, x.T, zeros], -1), torch.tensor([0.0, 0, -1]).expand(size, size, 3)
    surfaces = HitSurfaces(rays, rays, position, F.normalize(facets, dim=-1), zeros[..., None] + 1, *[position] * 3,
                           *[zeros] * 3)
    assert (footprints(surfaces)[..., 3:6] == 0).all()
    assert (footprints(surfaces)[..., 0, 0] > 0).all()


def test_a_fine_flat_panel_is_one_emitter():
    fine = np.concatenate([SQUARE / 8 + np.float32((i / 4 - 0.875, j / 4 - 0.875, 2)) for i in range(8)
                           for j in range(8)])
    emitters = DirectLight(lit_by(fine)).emitters
    assert len(emitters) == 1 and emitters.shapes.corners.shape == (1, 4, 3)
