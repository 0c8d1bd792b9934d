# SPDX-License-Identifier: GPL-3.0-or-later
"""Light at probes, interpolated to all pixels."""
import torch

from renderformer_v2.model.light.probes import GRID, Probes

UP = torch.tensor([[0.0, 0.0, 1.0]])


def test_pixels_between_probes_get_smooth_light_and_edges_stay():
    """Left half a floor, right half a wall far behind: no light runs from one to the other."""
    position = torch.zeros(16, 32, 3)
    position[..., 0] = torch.linspace(-1, 1, 32)
    position[:, 16:, 2] = 5.0
    normal = UP.expand(16, 32, 3)
    covered = torch.ones(16, 32, 1, dtype=torch.bool)
    covered[:3] = False
    light = Probes(position, normal, covered).interpolate(
        lambda x, n, _: {"light": (x[:, 2:] > 1).float().expand(-1, 3) + 1})["light"]
    assert light[:3].abs().max() == 0
    torch.testing.assert_close(light[3:, :16], torch.ones(13, 16, 3))
    torch.testing.assert_close(light[3:, 16:], torch.full((13, 16, 3), 2.0))
    flat_x = position * torch.tensor([1.0, 1, 0])
    ramp = Probes(flat_x, normal, covered | True).interpolate(lambda x, n, _: {"x": x[:, :1], "twice": 2 * x})
    inner = slice(GRID, -GRID)
    torch.testing.assert_close(ramp["x"][:, inner, 0], position[:, inner, 0], atol=1e-5, rtol=0)
    torch.testing.assert_close(ramp["twice"][..., :1], 2 * ramp["x"])
