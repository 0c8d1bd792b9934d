# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays from a camera to the tokens that it sees, through the middle of pixels and all over them."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.first_hits.camera_rays import FILTER_WIDTH, SAMPLE_POINTS, CameraRays
from tests.model.samples import flat, floor_scene, floor_view

SIZE = 32
PIXEL = 3 / SIZE  # of the floor, in world units
MIDDLE = SIZE // 2 * SIZE + SIZE // 2  # the pixel right of and below the middle of the picture


@pytest.fixture
def half():
    """A white floor that ends 0.3 pixels into the right half of the picture, and what is seen of it."""
    scene, (view, _) = floor_scene(), floor_view(SIZE, SIZE)
    corners = scene.triangles[:-1] * np.float32((1 + 0.3 * PIXEL, 2, 1)) / 2 - np.float32((0.5 - 0.15 * PIXEL, 0, 0))
    scene = flat(corners, (1, 1, 1))
    scene.normals[:] = 0, 0, 1
    return scene, view


def test_places_in_a_pixel_are_as_dense_as_the_filter():
    np.testing.assert_allclose(SAMPLE_POINTS.mean(0), 0.5, atol=0.02)
    assert (np.abs(SAMPLE_POINTS - 0.5) < FILTER_WIDTH / 2).all()
    assert SAMPLE_POINTS.std(0) == pytest.approx(0.44, abs=0.04)  # that of a Blackman-Harris window as wide


def test_samples_of_a_pixel_show_how_much_of_it_is_covered(half):
    scene, view = half
    samples = CameraRays(scene, view).sample(np.array([MIDDLE - 2, MIDDLE, MIDDLE + 2]))
    share = (samples.token >= 0).mean(1)
    assert share[0] == 1 and share[2] == 0 and share[1] == (SAMPLE_POINTS[:, 0] < 0.3).mean() and 0.2 < share[1] < 0.5
    np.testing.assert_allclose(samples.colors[0].mean(1)[1], share[1], rtol=1e-5)
    np.testing.assert_allclose(samples.position[0, :, 2], 0, atol=1e-5)
    np.testing.assert_allclose(samples.normal[0], [(0, 0, 1)] * len(SAMPLE_POINTS), atol=1e-5)
    assert not samples.position[2].any() and not samples.colors[:, 2].any()


def test_what_cameras_do_not_see_is_passed(half):
    scene, view = half
    hidden = np.ones(len(scene), bool)
    hidden[::2] = False
    met = CameraRays(replace(scene, seen=hidden), view).closest(np.float32([(-0.1, 0.1, -1), (-0.09, 0.02, -1)]))
    assert set(met.triangle.tolist()) <= {-1, *range(1, len(scene), 2)}
    assert CameraRays(replace(scene, seen=~hidden & False), view).closest(np.float32([(-0.1, 0, -1)])).triangle == -1


@pytest.mark.parametrize("clip_start, height", [(0, 1), (1.1, 0)])
def test_what_is_nearer_than_the_cameras_clipping_is_passed(half, clip_start, height):
    scene, view = half
    eye = view.camera_to_world[2, 3]
    pane = flat(scene.triangles + [0, 0, 1], (1, 1, 1))
    camera = CameraRays(scene.appended(pane), replace(view, clip_start=clip_start * (eye - 1)))
    ray = np.float32([(-0.2, 0.1, -2)])
    np.testing.assert_allclose(eye + ray[:, 2] * camera.closest(ray).distance, [height], atol=1e-4)


def test_a_ray_ends_at_a_point_unless_something_is_before_it_or_it_is_in_the_air(half):
    scene, view = half
    points = np.float32([(-0.3, 0.1, 0), (-0.3, 0.1, -0.5), (-0.3, 0.1, 0.5), (0.5, 0, 0)])
    assert CameraRays(scene, view).hits_lie_at(points, 0.01).tolist() == [True, False, False, False]
