# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays that walk through voxels against rays that look at every triangle."""
import numpy as np
import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.guided.bounce.voxels import HALVES, SIDE, Voxels

SQUARE = torch.tensor([[[-1.0, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]])


def ball(radius: float, rings: int = 12) -> torch.Tensor:
    """(T, 3, 3) around the origin."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij")
    points = radius * np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    corners = np.concatenate([np.stack([a, b, c], 2).reshape(-1, 3, 3), np.stack([a, c, d], 2).reshape(-1, 3, 3)])
    return torch.tensor(corners[np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
                                               axis=1) > 1e-9], dtype=torch.float32)


def nearest(triangles: torch.Tensor, origin: torch.Tensor, direction: torch.Tensor) -> torch.Tensor:
    """(P,) distance of the first triangle, infinity if there is none, by looking at all (Moeller and Trumbore 1997)."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = torch.linalg.cross(direction[:, None], v[None])
    scale = (u * across).sum(-1)
    away = origin[:, None] - a
    s, aside = (away * across).sum(-1) / scale, torch.linalg.cross(away, u[None].expand_as(away))
    t = (direction[:, None] * aside).sum(-1) / scale
    at = (v * aside).sum(-1) / scale
    return torch.where((s >= 0) & (t >= 0) & (s + t <= 1) & (at > 1e-3), at, torch.inf).amin(1)


def room() -> torch.Tensor:
    """An open box with a ball, a plate and a far ground."""
    floor = SQUARE * 0.5 - torch.tensor([0, 0, 0.5])
    walls = [floor, floor.roll(1, 2), floor.roll(2, 2), -floor]
    plate = SQUARE * 0.2 + torch.tensor([0.1, 0, 0.3])
    ground = SQUARE * 20 - torch.tensor([0, 0, 2.0])
    return torch.cat([*walls, ball(0.2), plate, ground])


def test_nearly_all_rays_meet_what_they_meet_first():
    generator = torch.Generator().manual_seed(0)
    origin = (torch.rand(4000, 3, generator=generator) - 0.5) * 0.9
    origin = origin[origin.norm(dim=-1) > 0.25]
    direction = F.normalize(torch.randn(len(origin), 3, generator=generator), dim=-1)
    expected = nearest(room(), origin, direction)
    triangle, distance = Voxels(room())(origin, direction)
    found = torch.where(triangle < 0, torch.inf, distance)
    pitch = 2 * HALVES[0] / SIDE
    clear = expected > 2 * pitch  # what is nearer may be missed
    same = (found.isinf() & expected.isinf()) | ((found - expected).abs() < 1e-3 * expected)
    assert clear.float().mean() > 0.8 and same[clear].float().mean() > 0.95


def test_a_surface_does_not_stand_in_its_own_way():
    triangles = ball(0.3)
    normal = F.normalize(triangles.mean(1), dim=-1)
    triangle, _ = Voxels(triangles)(triangles.mean(1) + 1e-3 * normal, normal)
    assert (triangle == -1).all()


@pytest.mark.parametrize("height", [0.01, 0.3, 3.0, 30.0])
def test_planes_near_and_far_are_met_where_they_are(height):
    plane = SQUARE * 4 * height + torch.tensor([0, 0, height])
    direction = F.normalize(torch.tensor([[0.3, 0.1, 1.0], [0, 0, 1], [0, 0, -1]]), dim=-1)
    triangle, distance = Voxels(plane)(torch.zeros(3, 3) - torch.tensor([0, 0, 0.1]), direction)
    assert (triangle >= 0).tolist() == [True, True, False]
    torch.testing.assert_close(distance[:2] * direction[:2, 2], torch.full((2,), height + 0.1), atol=1e-4, rtol=1e-4)


def test_nothing_is_met_where_there_is_nothing():
    triangle, _ = Voxels(torch.zeros(0, 3, 3))(torch.zeros(2, 3), torch.eye(3)[:2])
    assert triangle.tolist() == [-1, -1]
    assert Voxels(SQUARE)(torch.zeros(0, 3), torch.zeros(0, 3))[0].shape == (0,)
