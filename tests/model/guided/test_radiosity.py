# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounced light in closed form: what is known about it without a renderer."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.guided import patches, probes
from renderformer_v2.model.guided.light_prior import LightPrior
from renderformer_v2.model.guided.probes import gathered
from renderformer_v2.model.guided.radiosity import Radiosity
from renderformer_v2.model.scene import RenderScene, constant_tile
from tests.model.samples import floor_scene

UP = torch.tensor([[0.0, 0.0, 1.0]])


def built(scene: RenderScene) -> Radiosity:
    return Radiosity(scene, LightPrior(scene))


def test_a_point_that_faces_a_bright_plane_gathers_its_radiance():
    bounce = built(floor_scene(side=2))
    bounce.leaving = torch.ones_like(bounce.leaving)
    near, far = (bounce(torch.tensor([[0.05, 0.03, z]]), -UP)[0, 0].item() for z in (0.2, 3.0))
    # A square of side 2 at distance z: its form factor by the formula for parallel differential areas.
    for z, found in ((0.2, near), (3.0, far)):
        x = 1 / z
        expected = 4 / (2 * np.pi) * 2 * x / np.sqrt(1 + x * x) * np.arctan(x / np.sqrt(1 + x * x))
        assert found == pytest.approx(expected, rel=0.02)
    assert built(floor_scene())(torch.tensor([[0.0, 0.0, 0.5]]), UP).abs().max() == 0  # nothing above but the lamp


def flat(corners, color) -> RenderScene:
    n = len(corners)
    rows = np.zeros((n, 3), np.float32)
    return RenderScene(corners, np.zeros((n, 3, 3), np.float32), rows, rows, np.zeros((n, 2), np.float32),
                       np.zeros(n, np.int32), constant_tile(color)[None])


def walls(color) -> RenderScene:
    """The floor, grey, and a coloured wall on its left side."""
    scene = floor_scene(side=6)
    scene.tiles[:, :3] = 0.5
    floor = scene.triangles[~scene.is_light]
    wall = np.stack([np.full_like(floor[..., 0], -1), floor[..., 1], floor[..., 0] + 1], axis=-1)[:, ::-1]
    return scene.appended(flat(wall.copy(), color))


def test_a_coloured_wall_bleeds_onto_what_is_near_it():
    bounce = built(walls((0.8, 0.05, 0.05)))
    near, far = bounce(torch.tensor([[-0.8, 0.0, 0.0]]), UP)[0], bounce(torch.tensor([[0.9, 0.0, 0.0]]), UP)[0]
    assert near[0] > 3 * near[1] > 0 and near[0] > 2 * far[0] > 0


def test_no_more_than_a_whole_hemisphere_arrives():
    bounce = built(walls((0.8, 0.8, 0.8)))
    bounce.leaving = torch.ones_like(bounce.leaving)
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(0)) * 2 - 1
    normals = torch.nn.functional.normalize(torch.randn(200, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    assert bounce(points, normals).max() <= 1 + 1e-5


def test_merged_patches_give_nearly_the_same_light(monkeypatch):
    """Coarse walls beside a thin plate of many small triangles that face up and down."""
    fine = floor_scene(side=24).triangles[:-1] * 0.3 + np.float32((0.5, 0, 0.5))
    plate = flat(np.concatenate([fine, fine[:, ::-1] - np.float32((0, 0, 0.01))]), (0.2, 0.6, 0.8))
    scene = walls((0.8, 0.05, 0.05)).appended(plate)
    points = torch.tensor([[0.3, 0.2, 0.0], [-0.5, 0.5, 0.0], [0.8, -0.6, 0.0]])
    exact = built(scene)(points, UP.expand(3, 3))
    monkeypatch.setattr(patches, "PATCHES", 512)
    few = built(scene)
    assert len(few.center) == 512 < len(scene)
    torch.testing.assert_close(few(points, UP.expand(3, 3)), exact, rtol=0.1, atol=1e-3)


@pytest.mark.parametrize("side", [2, 40])
def test_a_ground_to_the_horizon_lights_what_stands_on_it_as_an_endless_one(side):
    """Coarse, so that it is split, and fine, so that it is merged: a wall sees it in half of its hemisphere."""
    ground = floor_scene(side).triangles[:-1] * np.float32((2000, 2000, 0)) - np.float32((0, 0, 0.2))
    bounce = built(flat(ground, (0.5, 0.5, 0.5)))
    bounce.leaving = torch.ones_like(bounce.leaving)
    wall = torch.tensor([[0.0, -1.0, 0.0]])
    for height in (-0.1, 0.0, 0.3):
        assert bounce(torch.tensor([[0.1, 0.2, height]]), wall)[0, 0].item() == pytest.approx(0.5, abs=0.06)


def test_pixels_between_probes_get_smooth_light_and_edges_stay(monkeypatch):
    """Left half a floor, right half a wall far behind: no light runs from one to the other."""
    position = torch.zeros(16, 32, 3)
    position[..., 0] = torch.linspace(-1, 1, 32)
    position[:, 16:, 2] = 5.0
    normal = UP.expand(16, 32, 3)
    covered = torch.ones(16, 32, 1, dtype=torch.bool)
    covered[:3] = False
    light = gathered(lambda x, n: (x[:, 2:] > 1).float().expand(-1, 3) + 1, position, normal, covered)
    assert light[:3].abs().max() == 0
    torch.testing.assert_close(light[3:, :16], torch.ones(13, 16, 3))
    torch.testing.assert_close(light[3:, 16:], torch.full((13, 16, 3), 2.0))
    ramp = gathered(lambda x, n: x[:, :1].expand(-1, 3), position * torch.tensor([1.0, 1, 0]), normal, covered | True)
    inner = slice(probes.GRID, -probes.GRID)
    torch.testing.assert_close(ramp[:, inner, 0], position[:, inner, 0], atol=1e-5, rtol=0)


def test_a_scene_of_lights_alone_gathers_nothing():
    scene = floor_scene()
    lights = scene.is_light
    alone = replace(scene, **{name: getattr(scene, name)[lights] for name in
                              ("triangles", "normals", "emission", "beam_axis", "beam_cosine", "tile_index")})
    radiosity = Radiosity(alone, LightPrior(alone))
    points = torch.zeros(3, 3)
    assert (radiosity(points, torch.eye(3)) == 0).all() and radiosity(points[:0], points[:0]).shape == (0, 3)
