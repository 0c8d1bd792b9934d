# SPDX-License-Identifier: GPL-3.0-or-later
"""A thin wall that no pixel shows keeps the light of its two sides apart."""
import numpy as np
import pytest
import torch

from renderformer_v2.model.light.probes import SMOOTHED, Probes
from renderformer_v2.model.light.separation import Separation
from renderformer_v2.model.light.tensor_rays import TensorRays
from renderformer_v2.model.scene_rays import scene_rays
from renderformer_v2.model.surface_kinds import OCCLUDING, Ray
from tests.model.samples import flat

SIZE = 16
ALONG = ((torch.arange(SIZE) + 0.5) / SIZE - 0.5) / 4  # positions of pixels on the floor, a quarter of a unit wide
WALL = np.float32([[(0, -1, 0), (0, 1, 0), (0, 1, 1)], [(0, -1, 0), (0, 1, 1), (0, 0, 1)]])
LIFTED = WALL + np.float32((0, 0, 0.3))
HALF = WALL * np.float32((1, 0.5, 1)) + np.float32((0, 0.5, 0))  # from the middle of the picture on


def floor(wall: np.ndarray, bump: float = 0.0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, Separation]:
    """Positions and normals (h, w, 3) of pixels seen from above, which are covered, and what separates them."""
    y, x = torch.meshgrid(ALONG, ALONG, indexing="ij")
    position = torch.stack([x, y, -bump * (x * x + y * y)], -1)
    normal = torch.nn.functional.normalize(torch.stack([2 * bump * x, 2 * bump * y, torch.ones_like(x)], -1), dim=-1)
    covered = torch.ones(SIZE, SIZE, 1, dtype=torch.bool)
    rays = TensorRays(scene_rays(flat(wall, (0.5, 0.5, 0.5))).among(OCCLUDING, Ray.SHADOW))
    planes = (tensor.permute(2, 0, 1) for tensor in (position, normal))
    return position, normal, covered, Separation(*planes, covered[..., 0], rays)


@pytest.mark.parametrize("grid", [1, 2])
def test_light_of_one_side_does_not_reach_the_other(grid):
    position, normal, covered, separation = floor(WALL)

    def light(x, n, number):
        return {"light": (x[:, :1] > 0).float()}
    for walls, mixed in ((separation, False), (None, True)):
        probes = Probes(position, normal, covered, grid, 1, separation=walls)
        made = probes.interpolate(light, filters=SMOOTHED)["light"]
        left, right = made[:, :SIZE // 2].max(), made[:, SIZE // 2:].min()
        assert (left > 0.05 and right < 0.95) if mixed else (left < 1e-3 and right > 1 - 1e-3)


@pytest.mark.parametrize("wall, bump", [(LIFTED, 0.0), (LIFTED, 8.0)])
def test_what_hangs_above_and_the_surface_itself_separate_nothing(wall, bump):
    assert not floor(wall, bump)[-1].exists


def test_beside_the_end_of_a_wall_there_is_a_way_around():
    separation = floor(HALF)[-1]
    middle = SIZE // 2

    def between(row: int, other: int) -> bool:
        return bool(separation.between(*map(torch.tensor, (row, middle - 1, other, middle))))
    assert between(SIZE - 1, SIZE - 1) and not between(0, 0) and not between(middle - 1, middle)
