# SPDX-License-Identifier: GPL-3.0-or-later
"""Rough glass blurs what lies behind it, and nothing else does."""
from dataclasses import replace

import pytest
import torch

from renderformer_v2.model.light.hit_surfaces import HitSurfaces
from renderformer_v2.model.light.specular.frosted import frosted
from tests.model.samples import floor_scene, floor_view, scene_light

STRIPES = (torch.arange(64) // 2 % 2).float()[None, :, None].expand(64, 64, 3)


@pytest.fixture
def glass() -> HitSurfaces:
    view, guides = floor_view()
    guides.transmission_color = guides.diffuse_color
    return HitSurfaces.of(scene_light(floor_scene()).scene, view, guides, 0, torch.device("cpu"))


def contrast(surfaces: HitSurfaces, roughness: float) -> float:
    surfaces = replace(surfaces, roughness=torch.full_like(surfaces.roughness, roughness))
    return frosted(STRIPES, surfaces)[28:36, 28:36].std().item()


def test_the_rougher_the_glass_the_fewer_stripes_are_left(glass):
    smooth, *rougher = (contrast(glass, roughness) for roughness in (0.1, 0.25, 0.35, 0.5, 0.8))
    assert smooth == STRIPES[28:36, 28:36].std().item()
    assert all(more < less for less, more in zip([smooth, *rougher], rougher))
    assert rougher[-1] < 0.2 * smooth


def test_means_keep_the_light_and_stay_within_the_glass(glass):
    glass = replace(glass, roughness=torch.ones_like(glass.roughness))
    left = torch.arange(64) < 32
    glass.transmission[:, ~left] = 0
    light = torch.where(left[:, None], 1.0, 5.0).expand(64, 64, 3)
    torch.testing.assert_close(frosted(light, glass), light)


def test_surfaces_that_are_no_glass_are_left_alone(glass):
    glass = replace(glass, roughness=torch.ones_like(glass.roughness),
                    transmission=torch.zeros_like(glass.transmission))
    assert frosted(STRIPES, glass) is STRIPES


def test_a_path_that_finds_light_of_a_lamp_by_chance_makes_no_blot(glass):
    glass = replace(glass, roughness=torch.full_like(glass.roughness, 0.4))
    light = torch.ones(64, 64, 3)
    light[32, 32] = 1e4
    assert 1 < frosted(light, glass).max() < 50
