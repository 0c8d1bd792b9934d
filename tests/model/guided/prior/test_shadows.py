# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known about shadows without a renderer: closed boxes, open skies, a plate under a lamp."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.guided.bounce.radiosity import Radiosity
from renderformer_v2.model.guided.prior.light_prior import LightPrior
from renderformer_v2.model.guided.prior.sky import sphere_directions
from renderformer_v2.model.scene import RenderScene, constant_tile
from tests.model.samples import floor_scene

UP = torch.tensor([[0.0, 0.0, 1.0]])
SQUARE = np.float32([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]])
BOX = np.concatenate([np.roll(SQUARE + np.float32((0, 0, z)), axis, axis=-1) for axis in range(3) for z in (-1, 1)])


def under_a_sky(corners: np.ndarray) -> RenderScene:
    n = len(corners)
    rows = np.zeros((n, 3), np.float32)
    return RenderScene(corners, np.zeros((n, 3, 3), np.float32), rows, rows, np.zeros((n, 2), np.float32),
                       np.zeros(n, np.int32), constant_tile((0.8, 0.8, 0.8))[None], np.ones((32, 64, 3), np.float32))


def test_no_sky_shines_into_a_closed_box():
    scene = under_a_sky(BOX)
    points = torch.rand(500, 3, generator=torch.Generator().manual_seed(0)) * 1.9 - 0.95
    normals = torch.nn.functional.normalize(torch.randn(500, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    prior = LightPrior(scene)
    assert prior.sky(points, normals).mean() < 0.01
    assert Radiosity(scene, prior)(points, normals).mean() < 0.02
    wall = torch.tensor(BOX.mean(axis=1))
    outwards = torch.where(wall.abs() > 0.9, wall, 0.0)
    assert prior.sky(wall, -outwards).mean() < 0.01
    assert prior.sky(wall, outwards).min() > 0.99


def test_an_open_sky_is_whole_and_a_wall_hides_half_of_it():
    floor = LightPrior(under_a_sky(SQUARE))
    assert floor.sky(torch.tensor([[0.3, 0.2, 0.0]]), UP).min() == 1
    wall = np.roll(SQUARE, 1, axis=-1) * np.float32((1, 2, 2)) + np.float32((0.2, 0, 0))
    beside = LightPrior(under_a_sky(wall)).sky(torch.tensor([[0.0, 0.0, 0.0]]), UP)
    assert beside.mean().item() == pytest.approx(0.5, abs=0.1)


def test_a_plate_keeps_a_lamp_from_what_is_below_it():
    scene = floor_scene()  # its lamp stands two units above the middle
    plate = under_a_sky(SQUARE * 0.3 + np.float32((0, 0, 1)))
    shaded = LightPrior(scene.appended(plate))
    points = torch.tensor([[0.0, 0.0, 0.0], [0.9, 0.9, 0.0], [0.0, 0.0, 1.0]])
    torch.testing.assert_close(shaded.arriving(points, UP.expand(3, 3))[:, 3], torch.tensor([0.0, 1.0, 1.0]))


def test_directions_are_spread_evenly():
    d = sphere_directions(64)
    torch.testing.assert_close(d.norm(dim=-1), torch.ones(64))
    torch.testing.assert_close(3 * d.T @ d / 64, torch.eye(3), atol=0.02, rtol=0)
