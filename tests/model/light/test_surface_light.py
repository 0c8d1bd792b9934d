# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture that the light at surfaces makes."""
from dataclasses import replace

import pytest
import torch

from renderformer_v2.model.light.surface_light import BEHIND, SurfaceLight


@pytest.fixture
def light() -> SurfaceLight:
    generator = torch.Generator().manual_seed(0)
    shapes = {name: (2, 3, 6, 5) for name in SurfaceLight.PICTURES} | {
        "albedo": (2, 3, 3, 6, 5), "direct": (2, 3, 3, 6, 5), "roughness": (2, 1, 6, 5)}
    pictures = {name: torch.rand(shape, generator=generator) for name, shape in shapes.items()}
    return SurfaceLight(**pictures, is_traced=torch.tensor([0.0, 1.0]), has_rays=torch.ones(2))


def test_lobes_add_up_and_traced_light_stands_for_all_direct_light(light):
    indirect, direct = light.indirect(), (light.direct * light.albedo).sum(1)
    for view, arriving in (0, direct[0] + light.glow[0]), (1, light.traced[1]):
        expected = arriving + (indirect[view] * light.albedo[view]).sum(0)
        torch.testing.assert_close(light.radiance()[view], expected)


@pytest.mark.parametrize("roughness", [0.0, 1.0])
def test_smooth_glass_shows_what_lies_behind_it_and_rough_glass_what_arrives_at_its_back(light, roughness):
    light.roughness[:] = roughness
    diffuse, glossy, transmission = light.indirect().unbind(1)
    assert torch.equal(diffuse, light.bounced) and torch.equal(glossy, light.reflected)
    torch.testing.assert_close(transmission, light.refracted + BEHIND * roughness * light.behind)


def test_without_albedo_nothing_but_glow_and_traced_light_is_left(light):
    black = replace(light, albedo=torch.zeros_like(light.albedo))
    assert torch.equal(black.radiance()[0], light.glow[0])
    assert torch.equal(black.radiance()[1], light.traced[1])


def test_rows_make_those_of_the_picture(light):
    rows = slice(2, 5)
    assert torch.equal(light.rows(rows).radiance(), light.radiance()[..., rows, :])
