# SPDX-License-Identifier: GPL-3.0-or-later
import math

import torch
from torch.nn import functional as F

from renderformer_v2.model.light.sampling import cosine_directions, disk_points, ggx_directions, r2_starts

NORMALS = F.normalize(torch.tensor([[0.0, 0.0, 1.0], [1.0, -2.0, 0.5], [-1.0, 0.0, 0.0]]), dim=-1)
START = torch.tensor([[0.3, 0.8]]).expand(3, 2)


def test_directions_are_unit_vectors_as_dense_as_their_cosines():
    found = cosine_directions(NORMALS, 512, START)
    torch.testing.assert_close(found.norm(dim=-1), torch.ones(3, 512), atol=1e-3, rtol=0)
    torch.testing.assert_close(found.mean(1), NORMALS * 2 / 3, atol=0.02, rtol=0)


def test_a_smooth_surface_reflects_one_direction_and_a_rough_one_a_lobe_around_it():
    outgoing = F.normalize(NORMALS + 0.4 * NORMALS.roll(1, 1), dim=-1)
    mirrored = 2 * (outgoing * NORMALS).sum(-1, keepdim=True) * NORMALS - outgoing
    spread = []
    for roughness in (0.05, 0.3, 0.6):
        towards, weight, *_ = ggx_directions(NORMALS, outgoing, torch.full((3,), roughness), 256, START)
        assert weight.min() >= 0 and weight.max() < 10
        along = (towards * mirrored[:, None]).sum(-1)
        spread.append(((1 - along) * weight).sum().item() / weight.sum().item())
    assert spread[0] < 1e-3 and 10 * spread[0] < spread[1] < spread[2] < 0.5


def test_few_directions_find_what_rough_surfaces_mirror_at_grazing_angles():
    """Beside many: facets are met as the viewer sees them."""
    outgoing = F.normalize(0.1 * NORMALS + NORMALS.roll(1, 1).cross(NORMALS, dim=1), dim=-1)

    def mirrored(count: int) -> torch.Tensor:
        towards, weight, *_ = ggx_directions(NORMALS, outgoing, torch.full((3,), 0.6), count, START)
        upward = (towards * NORMALS[:, None]).sum(-1).square()
        return torch.stack([weight.mean(1), (weight * upward).mean(1)])

    torch.testing.assert_close(mirrored(16), mirrored(4096), atol=0.02, rtol=0.02)


def test_density_is_that_of_the_directions():
    """The mean of its inverse is the solid angle of the upper half, of as many as end there."""
    outgoing = F.normalize(NORMALS + 0.8 * NORMALS.roll(1, 1), dim=-1)
    towards, _, _, density = ggx_directions(NORMALS, outgoing, torch.ones(3), 1 << 16, START)
    is_up = (towards * NORMALS[:, None]).sum(-1) > 0.1
    torch.testing.assert_close((is_up / density).mean(1), torch.full((3,), 2 * math.pi * 0.9), rtol=0.02, atol=0)


def test_points_fill_disks_across_their_normals():
    u, v = r2_starts(torch.arange(4096)).unbind(1)
    found = disk_points(NORMALS[1].expand(4096, 3), u, v)
    assert (found @ NORMALS[1]).abs().max() < 1e-5 and found.norm(dim=-1).max() <= 1
    torch.testing.assert_close(found.square().sum(-1).mean(), torch.tensor(0.5), atol=0.01, rtol=0)


def test_neighbours_in_a_row_have_different_samples():
    few = r2_starts(torch.arange(16))
    assert torch.pdist(few).min() > 0.1
