# SPDX-License-Identifier: GPL-3.0-or-later
"""Images in surfaces that are not quite smooth."""
from dataclasses import replace

import pytest
import torch

from renderformer_v2.model.light.hit_surfaces import HitSurfaces
from renderformer_v2.model.light.sampling import ggx_directions
from renderformer_v2.model.light.specular.glossy_image import blurred_image
from tests.model.samples import floor_scene, floor_view, scene_light


@pytest.fixture
def floor() -> HitSurfaces:
    view, guides = floor_view(96, 96)
    return HitSurfaces.of(scene_light(floor_scene()).scene, view, guides, 0, torch.device("cpu"))


def ceiling(surfaces: HitSurfaces, roughness: float, height: float) -> tuple[HitSurfaces, torch.Tensor, torch.Tensor]:
    """A floor so rough, where its paths end at a ceiling so high, and whether these ends lie at x > 0."""
    surfaces = replace(surfaces, roughness=torch.full_like(surfaces.roughness, roughness))
    along = surfaces.rays * torch.tensor([1.0, 1.0, -1.0])
    end = surfaces.position + along * (height / along[..., 2:])
    return surfaces, end, (end[..., :1] > 0).float()


def blurred(surfaces: HitSurfaces, roughness: float, height: float) -> torch.Tensor:
    surfaces, end, light = ceiling(surfaces, roughness, height)
    return blurred_image(light.expand(*light.shape[:2], 3), end, surfaces.is_covered, surfaces)[..., 0]


def test_what_is_farther_off_is_more_blurred_and_what_touches_is_sharp(floor):
    touching, near, far = (blurred(floor, 0.25, height)[48, 32:64] for height in (1e-3, 0.3, 2.0))
    steps = [picture.diff().abs().max().item() for picture in (touching, near, far)]
    assert steps[0] > 0.95 and steps[0] > 1.5 * steps[1] > 2 * steps[2]


def test_smooth_surfaces_show_the_image_as_it_is(floor):
    assert set(blurred(floor, 0.02, 1.0)[floor.is_covered[..., 0]].tolist()) == {0.0, 1.0}


@pytest.mark.parametrize(("roughness", "height"), [(0.2, 1.0), (0.25, 0.5), (0.3, 1.0)])
def test_an_edge_is_as_wide_as_the_lobe_makes_it(floor, roughness, height):
    """Beside the mean over directions of the lobe itself."""
    found = blurred(floor, roughness, height)[48, 24:72]
    x, n, out = (values[48, 24:72] for values in (floor.position, floor.normal, -floor.rays))
    towards, weight, *_ = ggx_directions(n, out, torch.full((48,), roughness), 512, torch.full((48, 2), 0.5))
    reached = x[:, None] + towards * (height / towards[..., 2:].clamp_min(1e-3))
    expected = ((reached[..., 0] > 0) * weight).sum(1) / weight.sum(1)
    torch.testing.assert_close(found, expected, atol=0.07, rtol=0)
    assert expected.diff().abs().max() < 0.3


def test_the_sky_counts_beside_surfaces(floor):
    """Where half of the lobe meets the sky, the image is half as bright."""
    surfaces, end, light = ceiling(floor, 0.25, 1.0)
    is_end = light > 0
    image = blurred_image(light, torch.where(is_end, end, 0), is_end, surfaces)[48, 24:72, 0]
    assert image.min() < 0.05 and image.max() > 0.95
    assert (image - 0.5).abs().min() < 0.15


def test_pixels_whose_paths_were_not_followed_count_for_nothing(floor):
    """Those of rougher surfaces and of surfaces that hardly reflect are black for another reason than what is there."""
    surfaces, end, _ = ceiling(floor, 0.25, 1.0)
    right = torch.arange(96) >= 48
    for other in (replace(surfaces, roughness=torch.where(right, 0.6, surfaces.roughness)),
                  replace(surfaces, glossy=torch.where(right[:, None], 0.0, surfaces.glossy))):
        light = (surfaces.is_covered & ~right[:, None]).float()
        image = blurred_image(light, end * light, light > 0, other)
        assert image[48, 24:48].min() > 0.999
