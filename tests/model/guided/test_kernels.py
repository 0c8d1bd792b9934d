# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels leave a picture as it is until they are trained; the bundled ones know what noisy edges look like."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.guided.features import SAMPLES, guided_view, noise_of
from renderformer_v2.model.guided.kernels import (
    CENTER,
    INPUTS,
    LATENT,
    LEAST_WEIGHT,
    RADIUS,
    WEIGHTS,
    KernelPredictor,
    antialiased,
    antialiased_views,
    apply_kernels,
    to_tensor,
)
from renderformer_v2.model.guided.network import load_network
from renderformer_v2.model.light_passes import Lobes
from renderformer_v2.model.weights.presets import BUNDLED, rf2_small, weights_folder
from tests.model.samples import floor_scene, floor_view, scene_light

FEW, MOST = 8, SAMPLES[1]


def covered(distance: np.ndarray, rng: np.random.Generator, samples: int) -> np.ndarray:
    """Coverage of pixels whose centres are so far inside an edge, by samples in a pixel's filter."""
    return (distance[..., None] + rng.normal(0, 0.4, (*distance.shape, samples)) > 0).mean(-1).astype(np.float32)


def inside(angle: float) -> np.ndarray:
    """(64, 64) pixels by which the centres lie inside the edge."""
    y, x = np.mgrid[-32:32, -32:32] + 0.5
    return (x - 0.3) * np.cos(angle) + y * np.sin(angle)


def bright_half(angle: float, samples: int, seed: int = 0):
    """A white half before a dark one, both matte and opaque: radiance and guides."""
    view, guides = floor_view(64, 64)
    distance = inside(angle)
    share = covered(distance, np.random.default_rng(seed), samples)[..., None]
    normal = np.where(distance[..., None] > 0, (0, 0, 1), (0, 1, 0)).astype(np.float32)
    color, radiance = 0.2 + 0.6 * share, 0.1 + 0.5 * share
    picture = lambda value: np.broadcast_to(value, (64, 64, 3)).astype(np.float32)  # noqa: E731
    guides = replace(guides, diffuse_color=picture(color), glossy_color=picture(0.04), transmission_color=picture(0),
                     normal=normal, alpha=np.ones((64, 64), np.float32), emission=picture(0), environment=picture(0),
                     traced=picture(radiance), samples=np.full((64, 64), samples, np.float32))
    return picture(radiance), guides


def test_an_untrained_predictor_leaves_every_pixel_as_it_is():
    kernels = KernelPredictor(4)(torch.randn(1, len(INPUTS), 9, 7))
    assert kernels.shape == (1, WEIGHTS, 9, 7)
    picture = torch.rand(1, 2, 9, 7)
    torch.testing.assert_close(apply_kernels(picture, kernels), picture, atol=1e-6, rtol=1e-6)


def test_a_kernel_takes_from_the_pixels_around():
    picture, kernels = torch.rand(1, 3, 8, 8), torch.zeros(1, WEIGHTS, 8, 8)
    kernels[:, CENTER + 1] = 0.25      # the pixel to the right
    kernels[:, CENTER - 2 * RADIUS - 1] = 0.75  # the one above
    found = apply_kernels(picture, kernels)
    mean = 0.25 * picture[..., 1:, 1:] + 0.75 * picture[..., :-1, :-1]
    torch.testing.assert_close(found[..., 1:, :-1], mean, atol=2 * LEAST_WEIGHT, rtol=0)
    torch.testing.assert_close(found[..., 0, -1], picture[..., 0, -1])  # what lies outside is like the outermost
    half = apply_kernels(picture, kernels, 32)
    torch.testing.assert_close(half - picture, (found - picture) / 2)


def test_what_shines_a_million_times_brighter_does_not_leak_through_weights_near_0():
    picture, kernels = torch.full((1, 1, 8, 8), 0.05), torch.full((1, WEIGHTS, 8, 8), 1e-3)
    picture[..., 4, 4] = 5e4
    kernels[:, CENTER] = 1 - 1e-3 * (WEIGHTS - 1)
    assert torch.equal(apply_kernels(picture, kernels), picture)


def trained_like() -> KernelPredictor:
    torch.manual_seed(0)
    predictor = KernelPredictor(4)
    torch.nn.init.normal_(predictor.leave.weight)
    torch.nn.init.zeros_(predictor.leave.bias)
    return predictor


@torch.no_grad()
def test_all_pictures_get_the_same_kernels_whatever_the_bands(monkeypatch):
    radiance, guides = bright_half(0.5, FEW)
    predictor = trained_like()
    pictures = {"combined": np.dstack([radiance, guides.alpha]), "half": 0.5 * radiance}
    found = antialiased(predictor, pictures, Lobes(radiance), guides)
    assert found["combined"].shape == (64, 64, 4) and np.abs(found["combined"][..., :3] - radiance).max() > 0.01
    np.testing.assert_allclose(found["combined"][..., :3], 2 * found["half"], rtol=1e-5)
    np.testing.assert_allclose(found["combined"][..., 3], 1, rtol=1e-5)
    monkeypatch.setattr("renderformer_v2.model.guided.kernels.BAND_PIXELS", 5 * 64)
    again = antialiased(predictor, pictures, Lobes(radiance), guides)
    for name, picture in found.items():
        np.testing.assert_allclose(again[name], picture, rtol=1e-4, atol=1e-5)


@torch.no_grad()
@pytest.mark.parametrize("samples, most", [(FEW, 0.7), (32, 0.8), (MOST, 1.0)])
@pytest.mark.parametrize("degrees", [8, 33, 70])
def test_the_bundled_kernels_bring_a_noisy_edge_nearer_to_the_truth(degrees, samples, most):
    predictor = load_network(weights_folder(BUNDLED)).kernel_predictor
    radiance, guides = bright_half(np.radians(degrees), samples)
    truth, _ = bright_half(np.radians(degrees), 4096, seed=1)
    found = antialiased(predictor, {"picture": radiance}, Lobes(radiance), guides)["picture"]
    before, after = (np.square(picture - truth).mean() for picture in (radiance, found))
    assert after < most * before
    far = np.abs(inside(np.radians(degrees))) > 8
    np.testing.assert_allclose(found[far], truth[far], atol=1e-3)  # what has no edge stays as it is


@torch.no_grad()
def test_what_glows_keeps_its_light():
    radiance, guides = bright_half(0.5, FEW)
    lamp = np.zeros_like(radiance)
    lamp[30:34, 30:34] = 50
    found = antialiased(trained_like(), {"lamp": lamp}, Lobes(radiance), replace(guides, emission=lamp))["lamp"]
    np.testing.assert_array_equal(found, lamp)
    faint = antialiased(trained_like(), {"lamp": lamp}, Lobes(radiance), replace(guides, emission=1e-5 * lamp))
    assert np.abs(faint["lamp"] - lamp).max() > 1


@torch.no_grad()
def test_kernels_do_not_depend_on_the_unit_of_light():
    radiance, guides = bright_half(0.5, FEW)
    guides = replace(guides, emission=0.01 * radiance, environment=0.5 * radiance)
    brighter = replace(guides, **{name: 1000 * getattr(guides, name) for name in ("emission", "environment", "traced")})
    predictor = trained_like()
    found, bright = (antialiased(predictor, {"picture": light}, Lobes(light), seen)["picture"]
                     for light, seen in ((radiance, guides), (1000 * radiance, brighter)))
    assert np.abs(found - radiance).max() > 0.01
    np.testing.assert_allclose(bright, 1000 * found, rtol=1e-4)


@torch.no_grad()
def test_the_decoder_of_the_transformer_has_a_say_in_the_kernels():
    radiance, guides = bright_half(0.5, FEW)
    predictor = trained_like()
    latent = np.random.default_rng(0).random((64, 64, LATENT)).astype(np.float32)
    without, none, some = (
        antialiased(predictor, {"picture": radiance}, Lobes(radiance, latent=x), guides)["picture"]
        for x in (None, 0 * latent, latent))
    np.testing.assert_array_equal(without, none)
    assert np.abs(some - none).max() > 1e-3


@torch.no_grad()
def test_views_in_training_have_the_kernels_that_pictures_have():
    view, guides = floor_view(64, 64)
    guides = replace(guides, traced=0.5 * guides.diffuse_color, samples=np.full_like(guides.alpha, 4))
    given = guided_view(scene_light(floor_scene()), view, guides, rf2_small())
    radiance, predictor = given.light.radiance(), trained_like()
    latent = torch.rand(1, LATENT, 64, 64)
    found = antialiased_views(predictor, radiance, given, latent)[0].permute(1, 2, 0).numpy()
    picture, radiance = (x[0].permute(1, 2, 0).numpy() for x in (given.complete(radiance), radiance))
    lobes = Lobes(radiance, latent=latent[0].permute(1, 2, 0).numpy())
    exposure = float(given.exposure)
    exposed = replace(guides, **{
        name: exposure * getattr(guides, name) for name in ("traced", "emission", "environment")})
    expected = antialiased(predictor, {"picture": picture}, lobes, exposed)["picture"]
    assert np.abs(expected - picture).max() > 0.01
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4)


def test_the_noise_that_is_seen_is_that_of_the_samples_between_those_of_the_training():
    samples = np.array([0.5, 1, FEW, 32, MOST, 4096])
    np.testing.assert_allclose(noise_of(samples), [8 ** 0.5, 8 ** 0.5, 1, 0.5, 0.25, 0.25])


def test_pictures_are_stacked_row_0_on_top():
    assert to_tensor(np.arange(6.0).reshape(1, 2, 3))[0, :, 0, 1].tolist() == [3, 4, 5]
