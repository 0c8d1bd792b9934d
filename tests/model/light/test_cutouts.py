# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that some light passes straight, such as net curtains: what goes through, and what is reflected."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.cutouts import Veils
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.tensor_rays import TensorRays
from renderformer_v2.model.scene import TRANSMISSION, RenderScene
from renderformer_v2.model.scene_rays import scene_rays
from renderformer_v2.model.surface_kinds import ALL, Ray
from tests.model.samples import flat, floor_scene

CLEAR = np.float32((0.6, 0.3, 0.3))
UP = torch.tensor([[0.0, 0.0, 1.0]])


def under_a_veil(color=(0.0, 0.0, 0.0), sky=1.0) -> RenderScene:
    """A floor below an even sky, and a sheet over it through which some of each colour goes straight."""
    square = np.float32([[(-9, -9, 0.2), (9, -9, 0.2), (9, 9, 0.2)], [(-9, -9, 0.2), (9, 9, 0.2), (-9, 9, 0.2)]])
    veil = flat(square, CLEAR + (1 - CLEAR.mean()) * np.float32(color))
    veil.tiles[:, TRANSMISSION], veil.clear = CLEAR.mean(), CLEAR[None].copy()
    scene = floor_scene(side=3, radiance=0.0).appended(veil)
    scene.environment = np.full((4, 8, 3), sky, np.float32)
    return scene


def test_light_of_the_sky_passes_by_the_share_of_each_colour():
    visible = DirectLight(under_a_veil()).visibility(torch.tensor([[0.1, 0.2, 0.0]]), UP).sky[0]
    np.testing.assert_allclose(visible, CLEAR, atol=0.02)


def test_as_many_rays_pass_as_light_does_and_have_its_colour():
    scene = under_a_veil()
    surfaces = TensorRays(scene_rays(scene).among(ALL, Ray.DIFFUSE))
    origin = torch.cat([torch.rand(4000, 2, generator=torch.Generator().manual_seed(1)) - 0.5, torch.ones(4000, 1)], 1)
    down = torch.tensor([[0.0, 0.0, -1.0]]).expand_as(origin)
    hits, tint = Veils.of(scene, "cpu").pass_some(surfaces, origin, down, surfaces.nearest(origin, down))
    passed = hits.distance > 0.9
    assert passed.float().mean().item() == pytest.approx(CLEAR.mean(), abs=0.03)
    np.testing.assert_allclose(tint[passed].mean(0), CLEAR / CLEAR.mean(), rtol=1e-3)
    assert (tint[~passed] == 1).all()


def test_what_does_not_pass_is_reflected_by_the_colour_of_the_rest():
    """Seen from above the sheet, which the sky lights; the floor is dark below it."""
    scene = under_a_veil(color=(0.5, 0.5, 0.5))
    scene.tiles[:-1, :3] = 0
    point, down = torch.tensor([[0.1, 0.2, 1.0]]), -UP
    light = Radiosity(scene, DirectLight(scene)).diffuse(point, down).indirect[0]
    np.testing.assert_allclose(light, (1 - CLEAR.mean()) * 0.5 * np.ones(3), rtol=0.15)
