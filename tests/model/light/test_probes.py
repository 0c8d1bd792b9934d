# SPDX-License-Identifier: GPL-3.0-or-later
"""Light at probes, interpolated to all pixels."""
import math

import torch

from renderformer_v2.model.light.probes import GRID, SMOOTHED, Probes

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


def test_light_in_mirrors_stays_on_its_facet():
    """Where a diffuse lobe takes two facets that differ by 16 degrees for one surface."""
    size, tilt = 16, math.radians(8)
    y, x = torch.meshgrid(*[torch.arange(size) - size / 2 + 0.5] * 2, indexing="ij")
    position = torch.stack([x, y, -x.abs() * math.tan(tilt)], -1) / size
    is_left = x[..., None] < 0
    normal = torch.stack([x.sign() * math.sin(tilt), 0 * x, 0 * x + math.cos(tilt)], -1)
    probes = Probes(position, normal, torch.ones_like(is_left), grid=2, finest=2)

    def compute(x, n, number):
        return {"light": (n[:, :1] < 0).float()}

    light, mirrored = (p.interpolate(compute, filters=SMOOTHED)["light"] for p in (probes, probes.for_gloss()))
    wrong = lambda picture: float((picture - is_left.float()).abs().max())  # noqa: E731
    assert wrong(mirrored) < 0.05 and wrong(light) > 0.2
