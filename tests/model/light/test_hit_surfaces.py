# SPDX-License-Identifier: GPL-3.0-or-later
"""What the surfaces that pixels show reflect."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.light.hit_surfaces import HitSurfaces
from renderformer_v2.model.scene import BASE_COLOR, IOR, METALLIC
from tests.model.samples import floor_scene, floor_view


def test_what_leans_away_from_the_viewer_shows_no_gloss():
    scene, (view, guides) = floor_scene(), floor_view()
    guides.normal[:, :32] *= -1
    is_toward = HitSurfaces.of(scene, view, guides, 0, torch.device("cpu")).is_toward
    assert not is_toward[32, 24] and is_toward[32, 40]


def test_a_dark_metal_reflects_more_at_grazing_angles_and_a_bright_one_hardly():
    """As the Principled BSDF: f0 is the base color of a metal, and a mean of both where it is partly a dielectric."""
    scene, (view, guides) = floor_scene(), floor_view()
    scene.tiles[:, IOR] = 1.3291
    for metallic, base, expected in ((1, 0.1, 0.1), (1, 0.9, 0.9), (0, 0.9, 0.04), (0.5, 0.6, 0.35)):
        scene.tiles[:, BASE_COLOR], scene.tiles[:, METALLIC] = base, metallic
        f0 = HitSurfaces.of(scene, view, guides, 0, torch.device("cpu")).f0[32, 32].item()
        assert f0 == pytest.approx(expected, abs=0.04)


def test_gloss_that_a_texel_does_not_know_is_that_of_plastic():
    """Of no reflectance at normal incidence, lamps at grazing angles would be millions of times as bright."""
    scene, (view, guides) = floor_scene(), floor_view()
    scene.tiles[:, IOR], scene.tiles[:, METALLIC] = 1, 0
    assert HitSurfaces.of(scene, view, guides, 0, torch.device("cpu")).f0[32, 32].item() == pytest.approx(0.04)


def test_bumps_finer_than_a_pixel_make_its_lobe_wider():
    scene, (view, guides) = floor_scene(), floor_view()
    smooth, bumpy = (HitSurfaces.of(scene, view, x, 0, torch.device("cpu")) for x in (
        guides, replace(guides, normal_variance=np.full_like(guides.alpha, 0.1))))
    assert smooth.roughness[32, 32].item() == pytest.approx(0.6, abs=1e-3)
    assert bumpy.roughness[32, 32].item() == pytest.approx((0.6 ** 4 + 0.1) ** 0.25, abs=1e-3)
    torch.testing.assert_close(bumpy.f0, smooth.f0)
