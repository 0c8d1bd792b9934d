# SPDX-License-Identifier: GPL-3.0-or-later
"""What the transformer is given of each pixel and ray bundle."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.guided import encoders
from renderformer_v2.model.guided.encoders import Guidance
from renderformer_v2.model.guided.exposure import display_encode
from renderformer_v2.model.guided.features import (
    FEATURES,
    LOGARITHMIC,
    MISS_DISTANCE,
    SURFACE,
    guided_view,
    with_exposure,
)
from renderformer_v2.model.light.surface_light import SurfaceLight
from renderformer_v2.model.weights.presets import rf2_small
from tests.model.samples import flat, floor_scene, floor_view, scene_light

CONFIG = rf2_small()


def inputs(width=64, height=64, radiance=40.0, traced=None):
    view, guides = floor_view(width, height)
    guides = guides if traced is None else replace(guides, traced=guides.diffuse_color * np.float32(traced))
    return guided_view(scene_light(floor_scene(radiance=radiance)), view, guides, CONFIG)


def test_bundles_lie_on_what_they_see_and_ahead_where_they_see_nothing():
    view = inputs(128, 64)
    positions = view.positions.view(8, 16, 3)
    assert view.features().shape == (1, len(FEATURES), 64, 128)
    torch.testing.assert_close(positions[4, 8, 2], torch.tensor(0.0), atol=1e-5, rtol=0)
    camera = torch.tensor([0.0, 0.0, 3.0])
    drawn_in = positions[0, 0].norm()
    ahead = positions[0, 0] / drawn_in / (2 - drawn_in)
    torch.testing.assert_close((ahead - camera).norm(), torch.tensor(MISS_DISTANCE))


def test_far_bundles_are_drawn_in():
    view, guides = floor_view()
    guides.position = guides.position + np.float32((0, 500, 0)) * (guides.alpha[..., None] > 0)
    far = guided_view(scene_light(floor_scene()), view, guides, CONFIG)
    assert 1.9 < far.positions.norm(dim=-1).max() <= 2
    assert far.features()[:, FEATURES["offset"]].abs().max() < 1


@pytest.mark.parametrize("traced", [None, 0.5])
def test_features_are_those_of_the_light_as_it_is_exposed(traced):
    view = inputs(traced=traced)
    light = view.light
    for name in LOGARITHMIC:
        exposed = torch.pow(10, view.features()[:, FEATURES[name]]) - 1
        torch.testing.assert_close(exposed, getattr(light, name).flatten(1, -3), atol=1e-5, rtol=1e-4)
    pictures = {"traced": light.is_traced * (light.traced + light.bounces()),
                "estimated": light.estimate() + light.bounces()}
    for name, picture in pictures.items():
        torch.testing.assert_close(view.features()[:, FEATURES[name]], display_encode(picture))
    assert torch.equal(view.features()[:, FEATURES["colors"]], light.albedo.flatten(1, 2))
    assert torch.equal(view.features()[:, FEATURES["roughness"]], light.roughness)
    assert (view.features()[:, FEATURES["is_traced"]] == bool(traced)).all() and light.is_traced.item() == bool(traced)


def test_noise_is_that_of_the_samples_and_without_rays_only_direct_light_without_shadows_is_known():
    view, guides = floor_view()
    guides = replace(guides, samples=np.full_like(guides.alpha, 32))
    shade = flat(np.float32([[[-1, -1, 1], [1, -1, 1], [0, 1, 1]]]), (0.5,) * 3)
    light = scene_light(floor_scene().appended(shade))
    given = guided_view(light, view, guides, CONFIG)
    assert (given.features()[:, FEATURES["noise"]] == 0.5).all()
    assert (given.features()[:, FEATURES["has_rays"]] == 1).all()
    bare = guided_view(replace(light, radiosity=None), view, guides, CONFIG)
    assert (bare.features()[:, FEATURES["has_rays"]] == 0).all()
    assert not any(getattr(bare.light, name).any() for name in SurfaceLight.OF_RAYS)
    assert (bare.features()[:, FEATURES["emitters"]][:, :3].norm(dim=1) - guides.alpha).abs().max() < 1e-5
    assert not given.features()[:, FEATURES["emitters"]].any()
    shadowed, unshadowed = (x.light.direct / x.exposure for x in (given, bare))
    assert (unshadowed >= shadowed - 1e-5).all() and (unshadowed > shadowed + 1e-3).any()


@pytest.mark.parametrize("bounces, may", [(None, 1), ((1, 0, 0, 1), 1), ((0, 4, 12, 12), 0), ((4, 4, 12, 0), 0)])
def test_a_view_says_whether_all_light_is_known(bounces, may):
    scene = replace(floor_scene(), bounces=None if bounces is None else np.int32(bounces))
    assert (guided_view(scene_light(scene), *floor_view(), CONFIG).is_known == may).all()


@pytest.mark.parametrize("has_rays, expected", [(True, 0.25), (False, 1)])
def test_without_rays_first_hits_are_at_least_as_noisy_as_in_training(has_rays, expected):
    view, guides = floor_view()
    guides.samples = np.full_like(guides.alpha, 128)
    light = scene_light(floor_scene())
    given = guided_view(light if has_rays else replace(light, radiosity=None), view, guides, CONFIG)
    assert (given.surface[:, SURFACE["noise"]] == expected).all()


def test_pixels_say_how_much_of_a_lobe_has_another_shape():
    scene = replace(floor_scene(), guessed=np.float32([0.75]))
    view, guides = floor_view()
    is_known = guided_view(scene_light(scene), view, guides, CONFIG).is_known
    np.testing.assert_array_equal(is_known[0, 0], np.where(guides.hit_triangle >= 0, 0.25, 1))


@pytest.mark.parametrize("bounces, may", [(None, 1), ((0, 4, 12, 12), 0)])
def test_traced_light_is_unreliable_where_a_denoiser_took_much_noise_away_and_all_light_is_known(bounces, may):
    view, guides = floor_view()
    light = scene_light(replace(floor_scene(), bounces=None if bounces is None else np.int32(bounces)))
    estimate = guided_view(light, view, guides, CONFIG)
    estimated = (estimate.light.estimate() / estimate.exposure)[0].permute(1, 2, 0).numpy()
    noise = 8 * estimated * np.random.default_rng(0).normal(size=guides.alpha.shape)[..., None].astype(np.float32)
    noise[:, 32:] = 0
    clean, noisy = (guided_view(light, view, replace(guides, traced=estimated, noise=values), CONFIG)
                    for values in (None, noise))
    assert not clean.unreliable.any()
    covered = guides.alpha > 0
    assert (noisy.unreliable[0, 0, :, :24].numpy()[covered[:, :24]].mean() > 0.5) == may
    assert not noisy.unreliable[..., 40:].any()


def test_exposure_scales_all_radiance_of_each_view_and_nothing_else():
    view = inputs(traced=0.5)
    brighter = with_exposure(view.light, torch.tensor([4.0]))
    torch.testing.assert_close(brighter.radiance(), 4 * view.light.radiance())
    assert torch.equal(brighter.albedo, view.light.albedo) and torch.equal(brighter.roughness, view.light.roughness)


def test_what_a_view_sees_is_exposed_alike_however_bright_it_is():
    """A dim room beside a bright one is no dark picture to the network."""
    bright, dim = inputs(traced=0.5), inputs(radiance=0.04, traced=0.5e-3)
    torch.testing.assert_close(dim.exposure, 1000 * bright.exposure, rtol=0.01, atol=0)
    torch.testing.assert_close(dim.features(), bright.features(), rtol=0.02, atol=1e-3)
    assert inputs(radiance=0.0).exposure == 1


@torch.no_grad()
def test_bands_of_a_large_picture_give_the_same_tokens(monkeypatch):
    view, encoder = inputs(128, 64), Guidance(replace(CONFIG, latent_dim=12))
    tokens = encoder.bundles(view)
    monkeypatch.setattr(encoders, "BAND_PIXELS", 24 * 128)
    with inference():
        torch.testing.assert_close(encoder.bundles(view), tokens)
