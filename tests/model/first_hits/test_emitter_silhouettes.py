# SPDX-License-Identifier: GPL-3.0-or-later
"""Silhouettes of emitters are as smooth as many samples would show them."""
from dataclasses import replace

import numpy as np
import pytest

from renderformer_v2.model.first_hits import emitter_silhouettes
from renderformer_v2.model.first_hits.camera_rays import CameraRays, cast_guides
from renderformer_v2.model.scene import EMISSION_SIZE
from tests.model.samples import flat, floor_scene, floor_view

SIZE, RADIANCE, SAMPLES = 48, 20.0, 8


@pytest.fixture
def seen():
    """A slanting lamp, its first hits with a few random samples, and the emission of very many."""
    view, _ = floor_view(SIZE, SIZE)
    turn = np.float32([(0.9, -0.3, 0), (0.3, 0.9, 0), (0, 0, 1)])
    scene = flat(floor_scene().triangles[:-1] @ turn * 0.4, (0, 0, 0))
    scene.emission[:] = RADIANCE
    share = CameraRays(scene, view).emission(np.arange(SIZE * SIZE), 1024)[1]
    sampled = np.random.default_rng(0).binomial(SAMPLES, share) / SAMPLES
    exact, noisy = (RADIANCE * np.tile(x.reshape(SIZE, SIZE, 1), 3).astype(np.float32) for x in (share, sampled))
    guides = replace(cast_guides(scene, view), emission=noisy, samples=np.full((SIZE, SIZE), SAMPLES, np.float32))
    return scene, view, guides, exact


def error(emission, exact):
    return np.abs(emission.clip(0, 1) - exact.clip(0, 1)).mean()


def test_silhouettes_are_as_many_samples_would_show_them(seen):
    scene, view, guides, exact = seen
    smooth = emitter_silhouettes.smoothed(guides, scene, view)
    assert error(smooth.emission, exact) < 0.3 * error(guides.emission, exact)
    assert smooth.emission.mean() == pytest.approx(exact.mean(), rel=0.03)


def test_how_bright_an_emitter_is_there_is_what_samples_around_say(seen):
    """A picture on it is brighter here than in the mean, which is all that its tokens know."""
    scene, view, guides, exact = seen
    smooth = emitter_silhouettes.smoothed(replace(guides, emission=2 * guides.emission), scene, view)
    assert smooth.emission.mean() == pytest.approx(2 * exact.mean(), rel=0.05)


def test_what_is_dark_of_a_picture_has_dark_silhouettes(seen):
    """As a wall beside its lit windows."""
    scene, view, guides, exact = seen
    dark = scene.triangles.mean(axis=1)[:, 0] < 0
    tiles = np.ones((2, 3, EMISSION_SIZE, EMISSION_SIZE), np.float16) * np.float16([0, 1])[:, None, None, None]
    picture = replace(scene, emission_tile=np.where(dark, 0, 1).astype(np.int32), emission_tiles=tiles)
    is_left = np.arange(SIZE) < SIZE // 2 - 5
    shown = np.where(is_left[:, None], 0, guides.emission)
    smooth = emitter_silhouettes.smoothed(replace(guides, emission=shown), picture, view).emission
    assert smooth[:, is_left].max() < 1e-3 * RADIANCE
    lit = np.s_[:, SIZE // 2 + 5:]
    assert error(smooth[lit], exact[lit]) < 0.4 * error(guides.emission[lit], exact[lit])


@pytest.mark.parametrize("change", [{"emission": 0.01}, {"samples": 128.0}])
def test_what_rays_see_otherwise_or_samples_show_already_stays(seen, change):
    """A hundredth of what it should be: something that rays do not meet is before it."""
    scene, view, guides, _ = seen
    guides = replace(guides, emission=guides.emission * change.get("emission", 1),
                     samples=np.full_like(guides.samples, change.get("samples", SAMPLES)))
    np.testing.assert_array_equal(emitter_silhouettes.smoothed(guides, scene, view).emission, guides.emission)


def test_very_many_silhouettes_stay(seen, monkeypatch):
    scene, view, guides, _ = seen
    monkeypatch.setattr(emitter_silhouettes, "RAYS", 1000)
    assert emitter_silhouettes.smoothed(guides, scene, view) is guides
