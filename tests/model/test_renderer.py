# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering with the bundled weights, and with weights whose transformer has a say in every pixel."""
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from renderformer_v2.model import progress
from renderformer_v2.model.camera import view_rays
from renderformer_v2.model.errors import RenderCancelled
from renderformer_v2.model.guided.network import load_network
from renderformer_v2.model.light.effort import FULL
from renderformer_v2.model.renderer import Renderer, padded
from renderformer_v2.model.scene import Guides
from tests.model.guided.weights import busy_network, write
from tests.model.samples import floor_scene, floor_view, walls


@pytest.fixture(scope="module")
def busy(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("busy"), busy_network())


@pytest.fixture(scope="module")
def idle(busy, tmp_path_factory) -> Path:
    """The same weights but for the end of the decoder."""
    network = load_network(busy)
    for p in network.pixel_decoder.leave.parameters():
        torch.nn.init.zeros_(p)
    return write(tmp_path_factory.mktemp("idle"), network)


@pytest.fixture(scope="module", params=["bundled", "busy"])
def renderer(request, busy) -> Renderer:
    return Renderer(*[busy] * (request.param == "busy"), device="cpu", precision="fp32")


@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_a_transformer_whose_outputs_are_zero_changes_no_picture_and_another_does(busy, idle, precision):
    view, guides = floor_view()
    changed, same = (Renderer(weights, device="cpu", precision=precision).encode(floor_scene())
                     for weights in (busy, idle))
    estimated = same.view(view, guides, replace(FULL, network=False))
    np.testing.assert_allclose(same.view(view, guides), estimated, rtol=1e-6, atol=0)
    assert np.abs(changed.view(view, guides) - estimated).max() > 1e-3 * estimated.max()


@pytest.mark.parametrize("is_traced", [False, True])
@pytest.mark.parametrize("weights", ["bundled", "idle"])
def test_a_black_object_in_a_lit_room_is_exactly_black(weights, is_traced, idle):
    """Without a share of the room's brightness, which a constant in the exposure of the view would be."""
    view, guides = floor_view()
    for name in ("diffuse_color", "glossy_color", "transmission_color"):
        getattr(guides, name)[:, :32] = 0
    guides.traced = 0.5 * guides.diffuse_color if is_traced else None
    encoded = Renderer(*[idle] * (weights == "idle"), device="cpu", precision="fp32").encode(walls((0.8, 0.3, 0.3)))
    radiance = encoded.view(view, guides)
    assert not radiance[:, :32].any() and radiance[32, 40:48].min() > 0


def test_picture_scales_with_the_light_and_keeps_odd_sizes(renderer):
    view, guides = floor_view(50, 37)
    dim, bright = (renderer.encode(floor_scene(radiance=r)).view(view, guides) for r in (10.0, 1000.0))
    assert dim.shape == (37, 50, 3) and np.isfinite(dim).all() and dim.max() > 0
    np.testing.assert_allclose(bright, 100 * dim, rtol=1e-2, atol=1e-5)


def test_a_scene_is_encoded_once_for_many_views(busy):
    renderer = Renderer(busy, device="cpu", precision="fp32", rays=False)
    encoded, steps = renderer.encode(floor_scene()), []
    view, guides = floor_view()
    first = encoded.view(view, guides)
    with progress.reporting(lambda text, fraction: steps.append(text)):
        again = encoded.view(view, guides)
    np.testing.assert_array_equal(first, again)
    assert encoded.tokens > len(floor_scene())
    assert steps and not any(text.startswith("Stage 1") for text in steps)


def test_progress_rises_and_can_cancel(renderer):
    said = []
    with progress.reporting(lambda text, fraction: said.append((text, fraction))):
        with progress.part(0.0, 0.5):
            encoded = renderer.encode(floor_scene(radiance=3.0))
        with progress.part(0.5, 1.0):
            encoded.view(*floor_view())
    fractions = [fraction for _, fraction in said]
    assert fractions == sorted(fractions) and 0 <= fractions[0] and fractions[-1] <= 1
    assert all(text for text, _ in said)

    def cancel(text, fraction):
        raise RenderCancelled()

    with pytest.raises(RenderCancelled), progress.reporting(cancel):
        renderer.encode(floor_scene(radiance=4.0))
    with pytest.raises(RenderCancelled), progress.reporting(cancel):
        encoded.view(*floor_view())


def part_of(view, guides, x, y, width, height):
    """A rectangle of a picture, as a render border gives it."""
    part = replace(view, width=width, height=height, principal=view.principal - np.float32((x, y)), corner=(x, y))
    return part, Guides(**{name: array[y:y + height, x:x + width] for name, array in guides.arrays().items()})


def test_padding_keeps_the_windows_of_the_picture_and_repeats_its_edge():
    whole, guides = floor_view(256, 192)
    view, larger = padded(*part_of(whole, guides, 70, 50, 60, 100), 64)
    assert (view.corner, view.width, view.height) == ((64, 0), 128, 192)
    np.testing.assert_allclose(view_rays(view)[1], view_rays(whole)[1][:, 64:192], atol=1e-6)
    np.testing.assert_array_equal(larger.position[50:150, 6:66], guides.position[50:150, 70:130])
    np.testing.assert_array_equal(larger.position[:50, 6:66], np.repeat(guides.position[50:51, 70:130], 50, axis=0))
    same, _ = padded(*floor_view(64, 64), 64)
    assert (same.width, same.height) == (64, 64)


@pytest.mark.parametrize("hinted, off", [(True, 1.5e-2), (False, 1e-2)])
def test_a_part_looks_as_it_does_in_the_picture(renderer, hinted, off):
    """Nearly: the network does not see what lies outside of the part, and its few rays are others."""
    encoded, (view, guides) = renderer.encode(floor_scene()), floor_view(320, 192)
    if hinted:
        guides.traced = 0.8 * encoded.view(view, guides)
    x, y, width, height = 70, 50, 100, 90
    expected = encoded.view(view, guides)[y:y + height, x:x + width]
    actual = encoded.view(*part_of(view, guides, x, y, width, height))
    assert actual.shape == expected.shape
    assert np.abs(actual - expected).mean() < off * expected.mean()


@pytest.mark.parametrize("arguments", [{"device": "cuda"}, {"device": "cpu", "precision": "fp16"}])
def test_what_the_machine_lacks_is_refused_with_advice(arguments):
    if arguments["device"] == "cuda":
        import torch
        if torch.cuda.is_available():
            pytest.skip("this machine has CUDA")
    with pytest.raises(ValueError, match="set Device|choose"):
        Renderer(**arguments)
