# SPDX-License-Identifier: GPL-3.0-or-later
"""Glossy lobes by angle, against brute-force integration."""
import math

import numpy as np
import pytest
import torch

from renderformer_v2.model.light.direct.glossy_lobe import facet_cosines, small_emitter_share
from renderformer_v2.model.light.fresnel import gain, layer_albedo, lobe_albedo
from renderformer_v2.model.material.reflectance import fresnel

UP = torch.tensor([[0.0, 0.0, 1.0]])


def seen_at(cosine: float) -> torch.Tensor:
    return torch.tensor([[math.sqrt(1 - cosine ** 2), 0.0, cosine]])


def hemisphere(count: int) -> torch.Tensor:
    """(count, 3) unit vectors, evenly dense by solid angle."""
    k = torch.arange(count) + 0.5
    z, phi = k / count, k * math.pi * (3 - math.sqrt(5))
    return torch.stack([(1 - z * z).sqrt() * phi.cos(), (1 - z * z).sqrt() * phi.sin(), z], -1)


@pytest.mark.parametrize("reflectance", [0.04, 0.6])
@pytest.mark.parametrize("roughness, cosine", [(0.4, 1.0), (0.4, 0.3), (0.9, 0.9), (0.9, 0.2)])
def test_a_lobe_is_what_it_reflects_of_light_from_everywhere(roughness, cosine, reflectance):
    """Lamps too small to widen it, all over the sky, next to the integral of the microfacets' formula: a dielectric by
    its real curve, as in Cycles, and metal by Schlick's."""
    count, tiny, alpha2 = 200_000, 1e-12, roughness ** 4
    towards, v = hemisphere(count), seen_at(cosine)
    half = torch.nn.functional.normalize(towards + v, dim=-1)
    facing, n_h, n_l = (half * v).sum(-1), half[:, 2], towards[:, 2]
    density = alpha2 / (math.pi * (n_h.square() * (alpha2 - 1) + 1).square())
    masked = 2 * n_l * cosine / (n_l * math.sqrt(alpha2 + (1 - alpha2) * cosine ** 2)
                                 + cosine * (alpha2 + (1 - alpha2) * n_l.square()).sqrt())
    curve = fresnel(facing.numpy(), np.float32(1.5)) if reflectance == 0.04 else 0.6 + 0.4 * (1 - facing.numpy()) ** 5
    slanting = torch.from_numpy(curve)
    expected = (density * masked * slanting / (4 * cosine)).mean() * 2 * math.pi
    albedo = lobe_albedo(*(torch.tensor([x]) for x in (reflectance, cosine, roughness)))
    assert albedo.item() == pytest.approx(expected.item(), rel=0.06)

    lobe = small_emitter_share(facet_cosines(towards.T[:, None], UP, v), torch.tensor(tiny), torch.tensor([roughness]),
                               torch.tensor([reflectance]))
    assert (lobe.mean() * 2 / tiny).item() == pytest.approx(1, rel=0.06)


def test_what_a_layer_gains_by_the_angle_of_a_lamp_is_nothing_if_lamps_are_all_around():
    cosine = (torch.arange(200) + 0.5)[None] / 200
    f0s, roughnesses = torch.tensor([0.04, 0.5]), torch.tensor([0.67, 0.3])
    gains = gain(f0s, cosine.expand(2, 200), roughnesses)
    torch.testing.assert_close((gains * 2 * cosine).mean(1), torch.ones(2), atol=0.02, rtol=0)
    for f0, of_layer, roughness in zip(f0s, gains, roughnesses, strict=True):
        slanting, steep = lobe_albedo(f0.expand(2), cosine[0, [40, 180]], roughness.expand(2))
        assert (of_layer[40] / of_layer[180]).item() == pytest.approx((slanting / steep).item(), rel=1e-3)


def test_a_dielectric_is_lit_less_from_where_the_viewer_is_than_from_opposite_at_a_slant():
    v, roughness, reflectance = seen_at(0.3), torch.tensor([0.8]), torch.tensor([0.04])
    ways = torch.cat([v, v * torch.tensor([-1.0, 1.0, 1.0])]).T[:, None]
    facets = facet_cosines(ways, UP, v)
    steep, slanted = small_emitter_share(facets, torch.tensor(1e-6), roughness, reflectance)[0]
    of_metal = small_emitter_share(facets, torch.tensor(1e-6), roughness, torch.ones(1))[0]
    assert slanted / steep > 3 * of_metal[1] / of_metal[0]


@pytest.mark.parametrize(("roughness", "expected"), [(0.15, 0.087), (0.5, 0.0575), (0.9, 0.027)])
def test_a_layer_reflects_light_from_everywhere_as_cycles_glossy_color_has_it(roughness, expected):
    assert layer_albedo(torch.tensor([0.04]), torch.tensor([roughness])).item() == pytest.approx(expected, rel=0.1)


def test_no_layer_reflects_nothing():
    assert layer_albedo(torch.zeros(1), torch.tensor([0.5])) == 0
