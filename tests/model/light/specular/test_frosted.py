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


def blurred(light: torch.Tensor, surfaces: HitSurfaces, behind: float = 10.0) -> torch.Tensor:
    """What glass shows whose paths end so many network units behind it."""
    return frosted(light, surfaces, surfaces.position - torch.tensor([0, 0, behind]), torch.full((64, 64), True))


def contrast(surfaces: HitSurfaces, roughness: float, behind: float = 10.0, wide: int = 1) -> float:
    """wide: how many times as wide as STRIPES they are."""
    surfaces = replace(surfaces, roughness=torch.full_like(surfaces.roughness, roughness))
    stripes = STRIPES.repeat_interleave(wide, 1)[:, :64]
    return blurred(stripes, surfaces, behind)[28:36, 24:40].std().item()


def test_the_rougher_the_glass_the_fewer_stripes_are_left(glass):
    smooth, *rougher = (contrast(glass, roughness) for roughness in (0.1, 0.25, 0.35, 0.5, 0.8))
    assert smooth == STRIPES[28:36, 24:40].std().item()
    assert all(more < less for less, more in zip([smooth, *rougher], rougher))
    assert rougher[-1] < 0.2 * smooth


def test_the_nearer_to_the_glass_the_more_stripes_are_left(glass):
    glass = replace(glass, position=glass.position / 10)
    far, *nearer = (contrast(glass, 0.5, behind, wide=4) for behind in (10.0, 0.5, 0.25, 0.05))
    assert all(more > less for less, more in zip([far, *nearer], nearer))
    assert nearer[-1] > 20 * far


def test_what_touches_the_glass_stays_sharp_before_a_far_wall_and_paths_lost_in_glass_do_not_matter(glass):
    glass = replace(glass, position=glass.position / 10, roughness=torch.full_like(glass.roughness, 0.5))
    touches = (torch.arange(64) > 31).expand(64, 64)
    end = glass.position - torch.where(touches, 0.005, 0.0)[..., None] * torch.tensor([0.0, 0, 1])
    light = torch.where(touches, 1.0, 5.0)[..., None].repeat(1, 1, 3)
    light[::7, ::5] = 0  # as these are
    shown = frosted(light, glass, end, touches & light.any(-1))[20:44, :, 0].mean(0)
    assert shown[36] < 1.1 and shown[27] > 3.5


def test_glass_that_is_seen_at_a_slant_is_as_smooth(glass):
    row, column = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    noise = torch.rand(64, 64, 3, generator=torch.manual_seed(0))

    def grain(slope: float) -> float:
        normal = torch.nn.functional.normalize(torch.tensor([-slope, 0, 1]), dim=0).expand(64, 64, 3)
        pane = replace(glass, position=0.004 * torch.stack([column, row, slope * column], -1), normal=normal,
                       rays=torch.tensor([0.0, 0, -1]).expand(64, 64, 3), roughness=torch.full((64, 64), 0.5))
        return blurred(noise, pane, 0.05)[16:48, 16:48].std().item()

    assert grain(5.0) < 1.2 * grain(0.0)


def test_means_keep_the_light_and_stay_within_the_glass(glass):
    glass = replace(glass, roughness=torch.ones_like(glass.roughness))
    left = torch.arange(64) < 32
    glass.transmission[:, ~left] = 0
    light = torch.where(left[:, None], 1.0, 5.0).expand(64, 64, 3)
    torch.testing.assert_close(blurred(light, glass), light)


def test_surfaces_that_are_no_glass_are_left_alone(glass):
    glass = replace(glass, roughness=torch.ones_like(glass.roughness),
                    transmission=torch.zeros_like(glass.transmission))
    assert blurred(STRIPES, glass) is STRIPES


def test_a_path_that_finds_light_of_a_lamp_by_chance_makes_no_blot(glass):
    glass = replace(glass, roughness=torch.full_like(glass.roughness, 0.4))
    light = torch.ones(64, 64, 3)
    light[32, 32] = 1e4
    assert 1 < blurred(light, glass).max() < 50
