# SPDX-License-Identifier: GPL-3.0-or-later
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.guided import guide_tensors as guides_module
from renderformer_v2.model.guided.decoding import BEHIND, MOST, OUTPUTS, REFRACTED, decode_bands, decode_light
from renderformer_v2.model.guided.guidance import Guidance
from renderformer_v2.model.guided.guide_tensors import (
    FEATURES,
    RADIANCE,
    UNSEEN_DISTANCE,
    exposed,
    guide_tensors,
    hit_reflectances,
    hit_roughness,
)
from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.scene import BASE_COLOR, IOR, METALLIC, ROUGHNESS, TRANSMISSION
from renderformer_v2.model.weights.presets import rf2_small
from tests.model.samples import floor_scene, floor_view, walls

PATCH = rf2_small().patch_size


def tensors(width=64, height=64, hinted=False):
    scene = floor_scene()
    view, guides = floor_view(width, height)
    guides.traced = guides.diffuse_color * 0.5
    prior = DirectLight(scene)
    if not hinted:
        guides.traced = None
    return guide_tensors(scene, view, guides, prior, Radiosity(scene, prior), PATCH)


def undecided() -> torch.Tensor:
    """Of a decoder that leaves the priors as they are."""
    return torch.zeros(1, len(OUTPUTS), 64, 64)


def test_bundles_lie_on_what_they_see_and_ahead_where_they_see_nothing():
    guides = tensors(128, 64)
    positions = guides.positions.view(8, 16, 3)
    assert guides.features.shape == (1, len(FEATURES), 64, 128)
    torch.testing.assert_close(positions[4, 8, 2], torch.tensor(0.0), atol=1e-5, rtol=0)
    camera = torch.tensor([0.0, 0.0, 3.0])
    drawn_in = positions[0, 0].norm()
    unseen = positions[0, 0] / drawn_in / (2 - drawn_in)
    torch.testing.assert_close((unseen - camera).norm(), torch.tensor(UNSEEN_DISTANCE))


def test_far_bundles_are_drawn_in():
    scene = floor_scene()
    view, guides = floor_view(64, 64)
    guides.position = guides.position + np.float32((0, 500, 0)) * (guides.alpha[..., None] > 0)
    prior = DirectLight(scene)
    far = guide_tensors(scene, view, guides, prior, Radiosity(scene, prior), PATCH)
    assert 1.9 < far.positions.norm(dim=-1).max() <= 2
    assert far.features[:, FEATURES["offset"]].abs().max() < 1


def test_an_undecided_decoder_shows_the_priors():
    guides = tensors()
    light = decode_light(undecided(), guides)
    torch.testing.assert_close(light["direct"], guides.prior)
    expected = (guides.prior * guides.colors).sum(1) + guides.bounced * guides.colors[:, 0]
    expected = expected + guides.reflected * guides.colors[:, 1]
    torch.testing.assert_close(light["image"], expected, atol=1e-3, rtol=0)
    assert light["image"].amax() > 0.01


@pytest.mark.parametrize(("raw", "factor"), [(30.0, MOST), (-30.0, 1 / MOST)])
def test_priors_are_corrected_within_bounds(raw, factor):
    guides, outputs = tensors(), undecided()
    outputs[:, OUTPUTS["direct"]] = raw
    torch.testing.assert_close(decode_light(outputs, guides)["direct"], factor * guides.prior)


def test_traced_light_stands_for_all_direct_light():
    guides = tensors(hinted=True)
    guides.bounced, guides.reflected = torch.zeros_like(guides.bounced), torch.zeros_like(guides.reflected)
    image = decode_light(undecided(), guides)["image"]
    torch.testing.assert_close(image, guides.traced, atol=1e-3, rtol=1e-4)
    assert image.amax() > 0.1 and guides.features[:, FEATURES["hinted"]].min() == 1


def test_what_a_view_sees_is_exposed_alike_however_bright_it_is():
    """A dim room beside a bright one is no dark picture to the network, and no constant is added to it."""
    bright = tensors(hinted=True)
    scene, (view, guides) = floor_scene(), floor_view(64, 64)
    guides.traced = guides.diffuse_color * np.float32(0.5e-3)
    scene.emission *= np.float32(1e-3)
    prior = DirectLight(scene)
    dim = guide_tensors(scene, view, guides, prior, Radiosity(scene, prior), PATCH)
    torch.testing.assert_close(dim.exposure, 1000 * bright.exposure, rtol=0.01, atol=0)
    torch.testing.assert_close(dim.features, bright.features, rtol=0.02, atol=1e-3)
    image = decode_light(undecided(), dim)["image"] / dim.exposure
    assert (image - dim.traced / dim.exposure).abs().max() < 1e-4
    black = exposed(replace(dim, **{name: torch.zeros_like(getattr(dim, name)) for name in RADIANCE}))
    assert black.exposure == 1


@pytest.mark.parametrize(("raw", "factor"), [(30.0, 4.0), (-30.0, 0.25)])
def test_traced_light_is_corrected_within_bounds(raw, factor):
    guides, outputs = tensors(hinted=True), undecided()
    outputs[:, OUTPUTS["traced"]] = raw
    light = decode_light(outputs, guides)
    torch.testing.assert_close(light["traced"], factor * guides.traced, atol=1e-5, rtol=1e-4)


def test_an_undecided_decoder_adds_a_share_of_the_radiosity():
    guides = tensors(hinted=True)
    guides.bounced = guides.bounced + 0.5
    guides.behind, guides.refracted = guides.behind + 0.3, guides.refracted + 0.7
    guides.colors = guides.colors + 0.2 * (guides.colors > 0)
    guides.colors[:, 2] += 0.5
    for rough in (0.0, 1.0):
        guides.features[:, FEATURES["roughness"]] = rough
        image = decode_light(torch.zeros(1, len(OUTPUTS), 64, 64), guides)["image"]
        transmitted = BEHIND * guides.behind if rough else REFRACTED * guides.refracted
        expected = (guides.traced + guides.bounced * guides.colors[:, 0] + guides.reflected * guides.colors[:, 1]
                    + transmitted * guides.colors[:, 2])
        torch.testing.assert_close(image, expected, atol=1e-3, rtol=0)


def test_light_behind_a_surface_is_gathered_where_it_lets_light_through():
    scene = floor_scene()
    view, guides = floor_view(64, 64)
    assert (tensors().behind == 0).all()
    guides.transmission_color = guides.diffuse_color
    guides.position = guides.position + np.float32((0, 0, 0.5)) * (guides.alpha[..., None] > 0)  # glass above the floor
    prior = DirectLight(scene)
    found = guide_tensors(scene, view, guides, prior, Radiosity(scene, prior), PATCH)
    assert found.behind[0, :, 32, 32].min() > 0.01 > 10 * found.bounced[0, :, 32, 32].max()


def test_smooth_glass_shows_lamps_and_sky_where_its_paths_end_and_rough_glass_what_arrives_at_its_back():
    scene, (view, guides) = floor_scene(), floor_view(64, 64)
    guides.transmission_color = guides.diffuse_color
    prior = DirectLight(scene)
    radiosity = Radiosity(scene, prior)
    straight = guide_tensors(scene, view, guides, prior, radiosity, PATCH)
    guides.refracted_light = np.full_like(guides.position, 2.0)
    for roughness in (0.0, 1.0):
        scene.tiles[:, ROUGHNESS] = roughness
        found = guide_tensors(scene, view, guides, prior, radiosity, PATCH)
        seen = found.features[0, FEATURES.index("alpha")] > 0
        through = found.prior[0, 2][:, seen] / found.exposure
        assert through.numpy() == pytest.approx(2 * (1 - roughness), rel=1e-5)
        assert not torch.equal(found.prior[0, 2], straight.prior[0, 2])


def test_a_rough_surface_shows_no_image_but_the_mean_of_light_that_has_bounced_before():
    scene, (view, guides) = walls((0.8, 0.8, 0.8)), floor_view(64, 64)
    ends = {"reflected_position": guides.position, "reflected_normal": guides.normal,
            "reflected_color": np.full_like(guides.position, 0.5), "traced": np.zeros_like(guides.position),
            "diffuse_color": np.zeros_like(guides.position)}  # of metal, whose first bounce is traced
    prior = DirectLight(scene)
    radiosity, shown = Radiosity(scene, prior), []
    for roughness in (0.1, 0.9):
        scene.tiles[:, ROUGHNESS] = roughness
        found = guide_tensors(scene, view, replace(guides, **ends), prior, radiosity, PATCH)
        seen = found.features[0, FEATURES.index("alpha")] > 0
        shown.append(found.reflected[0, :, seen] / found.exposure)
    image = 0.5 * found.bounced[0, :, seen] / found.exposure
    torch.testing.assert_close(shown[0], image)
    assert 0 < shown[1].mean() < 0.5 * image.mean()


def test_no_light_where_nothing_is_hit():
    guides = tensors(128, 64)
    image = decode_light(torch.full((1, len(OUTPUTS), 64, 128), 3.0), guides)["image"]
    empty = guides.features[:, FEATURES.index("alpha")] == 0
    assert empty.any() and (~empty).any()
    assert image.permute(1, 0, 2, 3)[:, empty].abs().amax() == 0


def test_what_a_surface_reflects_comes_from_the_texel_that_is_hit():
    """Plastic, metal, both, what has no layer at all, clear glass of the same index, and what is hit by chance."""
    scene, (_, guides) = floor_scene(), floor_view()
    scene.tiles[:, BASE_COLOR] = 0.6
    guides.hit_triangle[0, 0] = -1
    for metallic, ior, transmission, expected in ((0, 1.3291, 0, (0, 1, 0.04)), (1, 1.3291, 0, (0.6, 0, 0.04)),
                                                  (0.5, 1.3291, 0, (0.3, 0.5, 0.04)), (0, 1.0, 0, (0, 0, 0)),
                                                  (0, 1.5, 1, (0, 1, 0.04))):
        scene.tiles[:, METALLIC], scene.tiles[:, IOR], scene.tiles[:, TRANSMISSION] = metallic, ior, transmission
        found = hit_reflectances(scene, guides)
        np.testing.assert_allclose([each[32, 32] for each in found], expected, atol=1e-3)
        np.testing.assert_allclose([each[0, 0] for each in found], (0, 1, 0.04), atol=1e-6)


def test_roughness_comes_from_the_texel_that_is_hit():
    scene, (_, guides) = floor_scene(), floor_view()
    scene.tiles[0, 4, :, :16] = 0.25  # columns below 16: weight of corner 0 below one half
    roughness = hit_roughness(scene, guides)
    assert roughness[32, 32] == 0.25
    guides.hit_barycentric[...] = (0.8, 0.1)
    np.testing.assert_allclose(hit_roughness(scene, guides)[32, 32], 0.6, atol=1e-3)


@torch.no_grad()
def test_bands_of_a_large_picture_change_nothing(monkeypatch):
    whole, encoder = tensors(128, 64), Guidance(replace(rf2_small(), latent_dim=12))
    tokens = encoder.bundles(whole.features)
    monkeypatch.setattr(guides_module, "BAND_PIXELS", 24 * 128)
    guides = tensors(128, 64)
    for name in vars(whole):
        torch.testing.assert_close(getattr(guides, name), getattr(whole, name))
    raw = torch.randn(1, len(OUTPUTS), 64, 128, generator=torch.Generator().manual_seed(0))
    image = decode_light(raw, guides)["image"]
    torch.testing.assert_close(encoder.bundles(guides.features), tokens)
    assert torch.equal(decode_bands(raw, guides, ("image",))["image"], image)
