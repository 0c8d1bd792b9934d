# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering with the bundled weights."""
from dataclasses import replace

import numpy as np
import pytest

from model.errors import RenderCancelled
from model.renderer import Renderer, fingerprint, padded

from tests.model.samples import floor_scene, floor_view


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer("small", device="cpu", precision="fp32")


def test_picture_scales_with_the_light_and_keeps_odd_sizes(renderer):
    view, guides = floor_view(50, 37)
    dim, bright = (renderer.render(floor_scene(radiance=r), view, guides) for r in (10.0, 1000.0))
    assert dim.shape == (37, 50, 3) and np.isfinite(dim).all() and dim.max() > 0
    np.testing.assert_allclose(bright, 100 * dim, rtol=1e-2, atol=1e-3)


def test_nothing_but_the_camera_changed_keeps_stage_one(renderer):
    scene, steps = floor_scene(), []
    view, guides = floor_view()
    renderer.render(scene, view, guides)
    renderer.render(floor_scene(), view, guides, progress=lambda text, fraction: steps.append(text))
    assert steps and not any(text.startswith("Stage 1") for text in steps)
    changed = replace(scene, emission=scene.emission * 2)
    renderer.render(changed, view, guides, progress=lambda text, fraction: steps.append(text))
    assert any(text.startswith("Stage 1") for text in steps)
    assert fingerprint(scene) == fingerprint(floor_scene()) != fingerprint(changed)


def test_progress_rises_and_can_cancel(renderer):
    view, guides = floor_view()
    fractions = []
    renderer.render(floor_scene(radiance=3.0), view, guides, progress=lambda text, fraction: fractions.append(fraction))
    assert fractions == sorted(fractions) and 0 <= fractions[0] and fractions[-1] <= 1

    def cancel(text, fraction):
        raise RenderCancelled()

    with pytest.raises(RenderCancelled):
        renderer.render(floor_scene(radiance=4.0), view, guides, progress=cancel)


def test_padding_adds_pixels_that_hit_nothing():
    view, guides = padded(*floor_view(70, 64))
    assert (view.width, view.height) == (128, 64)
    assert (guides.hit_triangle[:, 70:] == -1).all() and guides.alpha[:, 70:].max() == 0
    same, _ = padded(*floor_view(64, 64))
    assert same.width == 64


@pytest.mark.parametrize("arguments", [{"device": "cuda"}, {"device": "cpu", "precision": "fp16"}])
def test_what_the_machine_lacks_is_refused_with_advice(arguments):
    if arguments["device"] == "cuda":
        import torch
        if torch.cuda.is_available():
            pytest.skip("this machine has CUDA")
    with pytest.raises(ValueError, match="choose"):
        Renderer("small", **arguments)
