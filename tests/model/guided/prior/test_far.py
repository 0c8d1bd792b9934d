# SPDX-License-Identifier: GPL-3.0-or-later
"""Distant light and what stands far around a scene."""
import math

import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.guided.prior.far import FarBlockers
from renderformer_v2.model.guided.prior.sky import sphere_directions

LEVEL = torch.tensor([[0.0, 0.0, 1.0], [0.9, 0.0, 0.1], [0.0, -0.7, 0.3]])
TOWARDS = F.normalize(LEVEL, dim=-1)


def unblocked(triangles: torch.Tensor, towards: torch.Tensor) -> torch.Tensor:
    return FarBlockers(triangles).unblocked(towards)


def box(size: float) -> torch.Tensor:
    """Inside of a box around the origin, open below: (10, 3, 3)."""
    corners = [torch.tensor([(-1.0, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)])]
    for quarter in range(4):
        c, s = math.cos(quarter * math.pi / 2), math.sin(quarter * math.pi / 2)
        corners.append(torch.tensor([(1.0, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)])
                       @ torch.tensor([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    return size * torch.stack([quad[rows] for quad in corners for rows in ([0, 1, 2], [0, 2, 3])])


def ground(size: float) -> torch.Tensor:
    quad = size * torch.tensor([(-1.0, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    return torch.stack([quad[[0, 1, 2]], quad[[0, 2, 3]]])


@pytest.mark.parametrize("size", [3.0, 12.0, 30.0])
def test_a_dome_far_around_shuts_distant_light_out(size):
    assert unblocked(torch.cat([box(size), ground(0.3)]), TOWARDS).tolist() == [0, 0, 0]


@pytest.mark.parametrize("size", [0.3, 30.0, 1e4])
def test_a_ground_lets_all_light_from_above_in(size):
    above = sphere_directions(40)[:18]
    assert unblocked(ground(size), above).tolist() == [1] * 18


def test_what_is_near_is_for_shadow_maps_and_nothing_shuts_out_nothing():
    assert unblocked(box(0.5), TOWARDS).tolist() == [1, 1, 1]
    assert unblocked(torch.zeros(0, 3, 3), TOWARDS).tolist() == [1, 1, 1]
    assert unblocked(box(9.0), TOWARDS[:0]).shape == (0,)
