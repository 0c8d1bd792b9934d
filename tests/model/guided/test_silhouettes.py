# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels on an edge show both sides by coverage; all others stay what they are."""
import numpy as np
import pytest

from renderformer_v2.model.guided.silhouettes import blended
from renderformer_v2.model.lobes import LOBES, Lobes
from renderformer_v2.model.scene import Guides

H, W = 9, 16
CEILING, WALL, SKY = slice(0, 4), slice(5, 7), slice(8, 9)
EDGE, HORIZON = 4, 7  # rows: half ceiling and half wall; half wall and half sky


@pytest.fixture
def corner():
    """A white ceiling that shines with 0.3, a grey wall with 0.1; the network is lost on the edge."""
    normal, color, light = (np.zeros((H, W, 3), np.float32) for _ in range(3))
    normal[CEILING], normal[WALL] = (0, 0, -1), (0, -1, 0)
    color[CEILING], color[WALL], light[CEILING], light[WALL] = 0.8, 0.4, 0.3, 0.1
    normal[EDGE], color[EDGE] = (0, -0.5, -0.5), 0.6
    normal[HORIZON], color[HORIZON], light[HORIZON] = (0, -0.5, 0), 0.2, 0.1
    light[EDGE] = np.where(np.arange(W) % 3 == 0, 0.0, 0.7)[:, None]  # dots
    alpha = np.ones((H, W), np.float32)
    alpha[HORIZON], alpha[SKY] = 0.5, 0
    zero = np.zeros_like(color)
    guides = Guides(zero, zero, color, zero, zero, zero, zero, alpha, alpha, alpha.astype(np.int32), zero[..., :2],
                    np.full_like(color, 0.05) * alpha[..., None])
    return guides, normal, light


def test_an_edge_is_between_its_sides_and_nothing_else_changes(corner):
    guides, normal, light = corner
    radiance = guides.traced + guides.diffuse_color * light
    found = blended(Lobes(radiance, guides.traced), guides, normal).radiance
    np.testing.assert_allclose(found[EDGE], 0.05 + 0.6 * 0.2, rtol=1e-5)
    rest = np.arange(H) != EDGE
    np.testing.assert_allclose(found[rest], radiance[rest], rtol=1e-6)


def test_light_of_the_lobes_still_makes_the_picture(corner):
    guides, normal, light = corner
    indirect = np.stack([light, light * 0, light * 0])
    radiance = guides.traced + guides.diffuse_color * light
    found = blended(Lobes(radiance, guides.traced, indirect, indirect), guides, normal)
    lit = guides.diffuse_color * found.indirect[LOBES.index("diffuse")]
    seen = light > 0
    np.testing.assert_allclose((guides.traced + lit)[seen], found.radiance[seen], rtol=1e-5)


def test_an_edge_without_a_clean_neighbour_stays(corner):
    guides, normal, light = corner
    radiance = guides.traced + guides.diffuse_color * light
    crowded = np.tile(np.float32((0, -0.4, -0.4)), (H, W, 1))
    np.testing.assert_allclose(blended(Lobes(radiance, guides.traced), guides, crowded).radiance, radiance, rtol=1e-6)
