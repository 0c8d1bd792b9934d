# SPDX-License-Identifier: GPL-3.0-or-later
"""Normalisation brings any scene into one range and does not change what it looks like."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.normalize import CENTRAL_IRRADIANCE, HALF_EXTENT, Normalization
from renderformer_v2.model.scene import HEIGHT, RenderScene, constant_tile
from tests.model.samples import floor_view


@pytest.fixture
def scene() -> RenderScene:
    rng = np.random.default_rng(3)
    corners = np.float32(rng.uniform(-1, 1, (400, 1, 3)) + 0.02 * rng.standard_normal((400, 3, 3)))
    emission = np.zeros((400, 3), np.float32)
    emission[:2] = 50.0
    corners[:2] += np.float32((0, 0, 4))
    zeros = np.zeros((400, 3), np.float32)
    return RenderScene(corners, np.zeros_like(corners), emission, zeros, zeros[:, :2], np.zeros(400, np.int32),
                       constant_tile()[None], np.full((256, 512, 3), 0.3, np.float32))


@pytest.mark.parametrize("size, light", [(1.0, 1.0), (250.0, 1.0), (0.004, 1e-3), (1.0, 1e4)])
def test_size_position_and_brightness_do_not_reach_the_network(scene, size, light):
    other = replace(scene, triangles=scene.triangles * np.float32(size) + np.float32(7 * size),
                    emission=scene.emission * np.float32(light), environment=scene.environment * np.float32(light))
    a, b = (Normalization.of(s).scene(s) for s in (scene, other))
    np.testing.assert_allclose(a.triangles, b.triangles, atol=2e-4)
    np.testing.assert_allclose(a.emission, b.emission, rtol=1e-3)
    np.testing.assert_allclose(a.environment, b.environment, rtol=1e-3)


def test_range_is_the_trained_one(scene):
    corners = Normalization.of(scene).scene(scene).triangles[2:].reshape(-1, 3)
    assert np.abs(corners).max() == pytest.approx(HALF_EXTENT, rel=1e-4)
    dark = replace(scene, emission=scene.emission * 0)
    white = Normalization.of(dark).scene(dark).environment
    assert white.mean() * np.pi == pytest.approx(CENTRAL_IRRADIANCE, rel=1e-3)


def test_what_the_camera_looks_at_fills_the_range_whatever_else_there_is(scene):
    far = scene.triangles.copy()
    far[5] *= 1000
    box = np.float32([(-0.2, 0, 1), (0.2, 0.5, 1.1)])
    looked_at = replace(scene, triangles=far, box=box)
    np.testing.assert_allclose(Normalization.of(looked_at).scene(looked_at).box,
                               [(-0.4, -0.5, -0.1), (0.4, 0.5, 0.1)], atol=1e-5)


def test_displacement_scales_with_the_geometry(scene):
    tiles = scene.tiles.copy()
    tiles[:, HEIGHT] = 0.5
    normalization = Normalization.of(scene)
    normalized = normalization.scene(replace(scene, tiles=tiles))
    assert normalized.tiles[0, HEIGHT, 0, 0] == pytest.approx(0.5 * normalization.scale, rel=1e-2)
    assert tiles[0, HEIGHT, 0, 0] == 0.5


def test_dark_and_empty_scenes_stay_finite(scene):
    for s in (replace(scene, emission=scene.emission * 0, environment=None), RenderScene()):
        normalization = Normalization.of(s)
        assert np.isfinite([normalization.scale, normalization.exposure, *normalization.center]).all()


def test_a_narrow_beam_that_misses_the_scene_does_not_darken_the_rest(scene):
    """Exposure goes by the light that arrives, not by the peak of a beam that shines elsewhere."""
    scene.environment = np.ones((256, 512, 3), np.float32)
    lights = scene.is_light
    scene.emission[lights] = 1e6
    beamed = replace(scene, beam_axis=scene.beam_axis.copy(), beam_cosine=scene.beam_cosine.copy())
    beamed.beam_cosine[lights] = (0.9998, 0.99995)
    at_centre = Normalization.of(scene).center - scene.triangles[lights].mean(axis=1)
    at_centre /= np.linalg.norm(at_centre, axis=1, keepdims=True)
    beamed.beam_axis[lights] = at_centre
    towards = Normalization.of(beamed).exposure
    beamed.beam_axis[lights] = -at_centre
    away = Normalization.of(beamed).exposure
    assert towards < 0.5 * away and away == pytest.approx(CENTRAL_IRRADIANCE / np.pi, rel=1e-2)  # the world alone
    beamed.beam_cosine[lights] = (0.0, 1e-3)  # an ordinary area lamp
    beamed.beam_axis[lights] = at_centre
    assert Normalization.of(beamed).exposure == pytest.approx(Normalization.of(scene).exposure, rel=1e-2)


def test_all_light_in_guides_is_exposed(scene):
    _, guides = floor_view()
    ones = np.ones_like(guides.position)
    guides = replace(guides, traced=ones, refracted_light=ones, emission=ones, environment=ones)
    normalization = Normalization.of(scene)
    found = normalization.guides(guides)
    for array in (found.traced, found.refracted_light, found.emission, found.environment):
        np.testing.assert_allclose(array, normalization.exposure, rtol=1e-6)
