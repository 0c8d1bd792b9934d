# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits behind smoke and fog are means over neighbouring pixels; everything else stays as it was."""
import numpy as np
import pytest

from renderformer_v2.model.first_hits.denoise_media import COLORS, Behind, crossed, smoothed, varies
from renderformer_v2.model.scene import Volumes
from tests.model.samples import floor_view

SIZE = 64
SMOOTHED = (*COLORS, "alpha")


@pytest.fixture
def noisy():
    """View and guides of a floor at z = 0 seen from z = 3, whose coverage and colours are 0 or 1 by chance."""
    view, guides = floor_view(SIZE, SIZE)
    reached = np.random.default_rng(5).uniform(size=(SIZE, SIZE)) < 0.5
    for name in SMOOTHED:
        values = getattr(guides, name)
        setattr(guides, name, np.float32(reached if values.ndim == 2 else np.repeat(reached[..., None], 3, axis=-1)))
    guides.environment = np.float32(1 - guides.alpha)[..., None] * np.float32((1, 2, 3))
    return view, guides


def fog(center, side: float, angle: float = 0.0) -> Volumes:
    one = np.ones((1, 3), np.float32)
    return Volumes(np.ones((1, 64), np.float32), np.float32([center]), np.float32([(0, 0, angle)]), one * 8 * side,
                   one, one)


def test_only_rays_that_cross_the_medium_are_smoothed(noisy):
    view, guides = noisy
    volumes = fog((0.3, 0, 1.0), 0.5)
    inside = crossed(guides, volumes, view)
    assert 0.02 < inside.mean() < 0.7
    assert inside[:, SIZE // 2:].sum() > 4 * inside[:, :SIZE // 2].sum()  # it stands to the right
    after = smoothed(guides, volumes, view)
    for name in SMOOTHED:
        before, now = getattr(guides, name), getattr(after, name)
        np.testing.assert_array_equal(now[~inside], before[~inside])
        assert now[inside].std() < 0.3 * before[inside].std()
        assert now[inside].mean() == pytest.approx(before[inside].mean(), abs=0.03)


def test_samples_that_end_in_a_medium_are_no_bumps(noisy):
    """They have no normal, so that the mean of a pixel's normals is short there."""
    view, guides = noisy
    guides.normal_variance, guides.matte_share = np.float32(1 - guides.alpha), guides.alpha
    volumes = fog((0.3, 0, 1.0), 0.5)
    inside, after = crossed(guides, volumes, view), smoothed(guides, volumes, view)
    assert not after.normal_variance[inside].any() and (after.matte_share[inside] == 1).all()
    np.testing.assert_array_equal(after.normal_variance[~inside], guides.normal_variance[~inside])


def test_a_turned_box_is_crossed_where_it_is(noisy):
    view, guides = noisy
    straight, turned = (crossed(guides, fog((0, 0, 1.0), 0.8, angle), view) for angle in (0.0, np.pi / 4))
    assert turned[SIZE // 2].sum() > 1.2 * straight[SIZE // 2].sum()


def test_a_medium_behind_the_floor_changes_nothing(noisy):
    view, guides = noisy
    hit = guides.hit_triangle >= 0
    inside = crossed(guides, fog((0, 0, -1.0), 0.5), view)
    assert hit.any() and not inside[hit].any()


def test_the_world_behind_a_medium_keeps_its_colour(noisy):
    view, guides = noisy
    after = smoothed(guides, fog((0, 0, 1.0), 2.0), view)
    np.testing.assert_allclose(after.environment, (1 - after.alpha)[..., None] * np.float32((1, 2, 3)), atol=0.02)


def test_without_media_the_guides_are_the_same_object(noisy):
    view, guides = noisy
    assert smoothed(guides, None, view) is guides


def test_edges_behind_a_medium_stay_as_smooth_as_what_is_known_of_them(noisy):
    """The right half shows a surface; the column before it sees a quarter of that."""
    view, guides = noisy
    share = np.zeros((SIZE, SIZE), np.float32)
    share[:, SIZE // 2:], share[:, SIZE // 2 - 1] = 1, 0.25
    guides.alpha *= np.where(share > 0.5, 1, 0.2).astype(np.float32)
    after = smoothed(guides, fog((0, 0, 1.5), 2.0), view, Behind(np.stack([share[..., None].repeat(3, -1)] * 3), share))
    color, alpha = after.diffuse_color[8:-8, :, 0].mean(0), after.alpha[8:-8].mean(0)
    middle = SIZE // 2
    assert color[middle - 2] == 0 and color[middle - 1] == pytest.approx(0.25 * color[middle], rel=0.4)
    assert alpha[middle - 1] == pytest.approx(0.75 * alpha[middle - 2] + 0.25 * alpha[middle], rel=0.15)


def test_surfaces_behind_a_medium_have_its_colour(noisy):
    """A grey floor behind fog that takes half of the red light and all of the blue."""
    view, guides = noisy
    guides.diffuse_color *= np.float32((0.5, 1, 0)) * 0.6
    full = np.ones((SIZE, SIZE), np.float32)
    after = smoothed(guides, fog((0, 0, 1.5), 2.0), view, Behind(np.full((3, SIZE, SIZE, 3), 0.6, np.float32), full))
    red, green, blue = after.diffuse_color[8:-8, 8:-8].mean((0, 1))
    assert green == pytest.approx(0.3, rel=0.1)
    assert red == pytest.approx(green / 2, rel=0.01) and blue == 0


def test_pixels_beside_others_vary_where_their_colours_do():
    picture = np.zeros((4, 6, 1), np.float32)
    picture[:, 3:] = 0.5
    assert varies(picture).any(0).tolist() == [False, False, True, True, False, False]
