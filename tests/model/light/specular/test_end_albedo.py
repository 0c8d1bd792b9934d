# SPDX-License-Identifier: GPL-3.0-or-later
"""The mean of textures within pixels, at the ends of paths."""
import numpy as np
import pytest

from renderformer_v2.model.light.specular.end_albedo import mean_albedo
from renderformer_v2.model.scene import TILE_SIZE
from tests.model.samples import flat

SIDE = 7  # pixels
NORMAL, LARGE = (0, 0, 1), [[(0, 0, 0), (1, 0, 0), (0, 1, 0)]]


def striped(period: int):
    """A triangle with stripes across X, black and white."""
    scene = flat(np.float32(LARGE), (0.0, 0.0, 0.0))
    scene.tiles[..., :3, :, np.arange(TILE_SIZE) % (2 * period) < period] = 1
    return scene


def means(scene, spread: float, has_end=True, apart=0.0) -> np.ndarray:
    """(SIDE, SIDE) of a square of so many network units, which SIDE x SIDE pixels show; every other is `apart`."""
    row, column = (x.ravel() for x in np.indices((SIDE, SIDE)))
    place = np.stack([column, row, 0 * row], -1) * spread / SIDE + (0.05, 0.05, 0)
    place[:, 2] += apart * ((row + column) % 2)
    triangle = np.where(np.broadcast_to(has_end, len(row)), 0, -1).astype(np.int32)
    albedo = np.zeros((len(row), 3), np.float32) + (0.2, 0.3, 0.4)
    normal = np.float32([NORMAL]).repeat(len(row), 0)
    return mean_albedo(scene, row, column, np.float32(place), normal, triangle, albedo).reshape(SIDE, SIDE, 3)


def test_fine_stripes_are_grey():
    mean = means(striped(1), spread=SIDE * 2 / TILE_SIZE)
    np.testing.assert_allclose(mean, np.full_like(mean, 0.5), atol=1e-3)


def test_wide_stripes_stay_as_they_are():
    mean = means(striped(2), spread=SIDE / TILE_SIZE / 4)
    is_mixed = (mean > 0) & (mean < 1)
    assert mean.min() == 0 and mean.max() == 1 and is_mixed.mean() < 0.35


@pytest.mark.parametrize("change", ({"has_end": False}, {"apart": 0.5}))
def test_where_the_next_pixels_show_nothing_of_the_same_surface_the_albedo_is_that_of_the_point(change):
    mean = means(striped(1), spread=SIDE * 2 / TILE_SIZE, **change)
    np.testing.assert_allclose(mean, np.broadcast_to(np.float32((0.2, 0.3, 0.4)), mean.shape))
