# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray bundles see the tokens on their way to the emitters."""
from dataclasses import replace

import pytest
import torch

from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.guided import shadows
from renderformer_v2.model.guided.features import guided_view
from renderformer_v2.model.guided.guided_inputs import guided_inputs
from renderformer_v2.model.guided.shadows import (
    CLEARANCE,
    ShadowAttention,
    bundle_emitters,
    line_to,
    squared_distance,
)
from renderformer_v2.model.light.direct.emitter_light import EMITTER
from renderformer_v2.model.material.mappers import load_material_mapper
from tests.model.guided.weights import busy_network
from tests.model.samples import floor_scene, floor_view, scene_light


@pytest.fixture(scope="module")
def network():
    return busy_network()


@pytest.fixture
def view(network):
    return guided_view(replace(scene_light(floor_scene()), radiosity=None), *floor_view(), network.config)


def test_distances_are_those_from_the_line():
    random = torch.Generator().manual_seed(1)
    origin, places = (torch.randn(1, count, 3, generator=random) for count in (5, 7))
    toward = torch.nn.functional.normalize(torch.randn(1, 5, 3, generator=random), dim=-1)
    length = torch.tensor([[0.3, 0.05, 1.0, 2.0, 4.0]])
    steps = torch.linspace(0, 1, 2001)[:, None]
    for i in range(5):
        far = max(float(length[0, i]) - CLEARANCE, CLEARANCE)
        line = origin[0, i] + (CLEARANCE + (far - CLEARANCE) * steps) * toward[0, i]
        torch.testing.assert_close(squared_distance(origin, toward, length, places)[0, i],
                                   torch.cdist(places[0], line).amin(1).square(), atol=1e-3, rtol=1e-3)


def test_bundles_look_at_the_emitter_of_their_pixels(view):
    emitters = bundle_emitters(view.emitters, 8)
    toward, length = line_to(emitters[0, :, 0])
    lamp = torch.tensor([0.0, -0.03, 2.0])
    lit = emitters[0, :, 0, EMITTER["share"]].amax(-1) > 0.9
    torch.testing.assert_close((view.positions[0] + toward * length[:, None])[lit], lamp.expand(int(lit.sum()), 3),
                               atol=0.06, rtol=0)
    assert lit.sum() > 20


@torch.no_grad()
def test_what_stands_between_counts_and_what_does_not_stands_back(network):
    attention = ShadowAttention(network.config)
    torch.nn.init.normal_(attention.out_proj.weight)
    torch.nn.init.zeros_(attention.k_proj.weight)  # the place alone counts
    rays, tokens = torch.randn(1, 1, 192), torch.randn(1, 40, 192)
    emitters = torch.zeros(1, 1, 3, len(EMITTER))
    emitters[..., EMITTER["toward"]], emitters[..., EMITTER["nearness"]] = torch.tensor([0.0, 0, 1]), 1 / 3
    places = torch.randn(1, 40, 3) * 0.2 + torch.tensor([3.0, 0, 0])
    places[0, :2] = torch.tensor([[0, 0, 1.0], [0.02, 0, 0.5]])
    is_triangle = torch.ones(1, 40, dtype=torch.bool)

    def seen(tokens):
        return attention(rays, torch.zeros(1, 1, 3), emitters, tokens, places, is_triangle)

    before, others = seen(tokens), tokens.clone()
    others[:, 2:] = torch.randn(1, 38, 192)
    torch.testing.assert_close(seen(others), before, atol=1e-3, rtol=1e-3)
    others[:, :1] = torch.randn(1, 1, 192)
    assert (seen(others) - before).abs().max() > 0.1


@torch.no_grad()
def test_pieces_give_what_the_whole_gives_and_light_by_rays_does_without(network, view, monkeypatch):
    context = network.encode_scene(guided_inputs(floor_scene(), network.config, load_material_mapper()))
    whole = network.ray_tokens(context, view)
    assert (whole - network.embed_rays(view)).abs().max() > 1e-3
    monkeypatch.setattr(shadows, "QUERIES", 10)
    with inference():
        torch.testing.assert_close(network.ray_tokens(context, view), whole, atol=1e-4, rtol=1e-4)
    with_rays = guided_view(scene_light(floor_scene()), *floor_view(), network.config)
    assert torch.equal(network.ray_tokens(context, with_rays), network.embed_rays(with_rays))
