# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays are guided to where light arrives from, and weighted so that their mean stays what it was."""
import math

import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.light.bounce.bright_patches import BrightPatches
from renderformer_v2.model.light.bounce.guide import BINS, Guide
from renderformer_v2.model.light.bounce.matte_rays import MatteRays
from renderformer_v2.model.light.sampling import cosine_directions, r2_starts

POINTS = 512
LAMP = F.normalize(torch.tensor([0.5, 0.3, 0.8]), dim=0)  # the middle of all light
COSINE = math.cos(math.radians(12))  # of the angle to its border
SHARE = LAMP[2] * (1 - COSINE**2)    # of the light from everywhere, by the cosine


def points(count: int = POINTS) -> tuple[torch.Tensor, torch.Tensor]:
    """On a floor of a tenth of a unit, and the normals there."""
    generator = torch.Generator().manual_seed(0)
    x = torch.cat([torch.rand(count, 2, generator=generator) * 0.1, torch.zeros(count, 1)], 1)
    return x, torch.tensor([[0.0, 0.0, 1.0]]).expand(count, 3)


def lamp(direction: torch.Tensor) -> torch.Tensor:
    return (direction @ LAMP > COSINE).float()


def guide_by(bounced, sky) -> Guide:
    """Of what arrives by such radiance of directions."""
    x, n = points()
    direction = cosine_directions(n, 16, r2_starts(torch.arange(POINTS)))
    return Guide(x, n, direction, bounced(direction), sky(direction))


def nothing_hit(rays: MatteRays) -> tuple[torch.Tensor, torch.Tensor]:
    """Triangles and distances."""
    count = rays.direction[..., 0].numel()
    return torch.full((count,), -1), torch.full((count,), torch.inf)


@pytest.fixture(scope="module")
def guide() -> Guide:
    return guide_by(lamp, lambda direction: torch.zeros_like(direction[..., 0]))


def test_directions_are_chosen_with_the_density_that_is_told(guide):
    x, n = points(1)
    row = guide.rows(x, n)
    everywhere = F.normalize(torch.randn(1, 1 << 18, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    density = guide.density(row, everywhere)
    assert density.mean() * 4 * math.pi == pytest.approx(1, rel=0.05)
    chosen = guide.sample(row, 1 << 14, torch.tensor([[0.3, 0.6]]))
    assert chosen.norm(dim=-1) == pytest.approx(1, abs=1e-4)
    assert (guide.density(row, chosen) > 0).all()
    # The mean of 1 / density over what was chosen is the solid angle that can be chosen.
    reached = (density > 0).float().mean() * 4 * math.pi
    assert (1 / guide.density(row, chosen)).mean() == pytest.approx(float(reached), rel=0.05)
    assert lamp(chosen).mean() > 5 * SHARE


def test_points_elsewhere_or_on_another_side_have_no_guide(guide):
    x, n = points(4)
    assert (guide.rows(x, n) < guide.none).all()
    assert (guide.rows(x + 30, n) == guide.none).all() and (guide.rows(x, -n) == guide.none).all()


def test_the_sky_attracts_as_many_rays_as_all_surfaces_at_most():
    x, n = points(1)

    def aside(direction):
        return (direction[..., 0] < -0.5).float()

    for strength, least, most in ((1e-3, 0.9, 1.0), (1e3, 0.4, 0.6)):
        guide = guide_by(lamp, lambda direction, strength=strength: strength * aside(direction))
        chosen = guide.sample(guide.rows(x, n), 4096, torch.zeros(1, 2))
        assert least < (chosen @ LAMP > 0.8).float().mean() <= most


@pytest.mark.parametrize("plain", [False, True])
def test_weighted_rays_have_the_mean_of_rays_by_the_cosine(guide, plain):
    x, n = points()
    rays = MatteRays(x, n, r2_starts(torch.arange(POINTS)), 24, 0, None, None if plain else guide)
    weight, _ = rays.weights(*nothing_hit(rays))
    assert weight.mean() == pytest.approx(1, rel=0.02)
    assert (weight * lamp(rays.direction)).mean() == pytest.approx(float(SHARE), rel=0.05)


def test_guided_rays_are_less_noisy(guide):
    x, n = points()
    noise = []
    for some in (None, guide):
        rays = MatteRays(x, n, torch.rand(POINTS, 2, generator=torch.Generator().manual_seed(2)), 24, 0, None, some)
        weight, _ = rays.weights(*nothing_hit(rays))
        noise.append((weight * lamp(rays.direction)).mean(1).std())
    assert noise[1] < 0.6 * noise[0]


def test_where_no_light_arrives_rays_are_those_by_the_cosine():
    dark = guide_by(*[lambda direction: torch.zeros_like(direction[..., 0])] * 2)
    x, n = points(8)
    assert (dark.rows(x, n) == dark.none).all() and dark._share.shape == (1, BINS)
    rays = MatteRays(x, n, r2_starts(torch.arange(8)), 24, 0, None, dark)
    assert torch.allclose(rays.weights(*nothing_hit(rays))[1], torch.ones(8, 24), atol=1e-4)


def test_rays_that_are_not_aimed_have_the_mean_of_the_cosine_among_themselves(guide):
    """They find the sky, which no ray is aimed at: what is bright would count less among what hides it."""
    corners = torch.tensor([[[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [0.0, 1.0, 1.0]]])
    bright = BrightPatches(corners, torch.tensor([True]), torch.tensor([0]), torch.tensor([1.0, 0.0]))
    x, n = points()
    rays = MatteRays(x, n, r2_starts(torch.arange(POINTS)), 24, 12, bright, guide)
    count = rays.direction[..., 0].numel()
    of_all, unaimed = rays.weights(torch.zeros(count, dtype=torch.long), torch.ones(count))
    assert unaimed.shape == (POINTS, 24) and unaimed.mean() == pytest.approx(1, rel=0.02)
    assert of_all[:, :24].mean() < 0.95
