# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray bundles hear of the surfaces around them, of what is between them and emitters, and of nothing else."""
from dataclasses import replace

import pytest
import torch

from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.guided import light_attention
from renderformer_v2.model.guided.features import guided_view
from renderformer_v2.model.guided.guided_inputs import guided_inputs
from renderformer_v2.model.guided.light_attention import (
    GATHERING,
    Bundles,
    GatheringHeads,
    ShadowHeads,
    Surfaces,
    bundle_emitters,
    line_to,
)
from renderformer_v2.model.light.direct.emitter_light import EMITTER
from renderformer_v2.model.material.mappers import load_material_mapper
from tests.model.guided.weights import busy_network
from tests.model.samples import floor_scene, floor_view, scene_light

WIDTH = 12
SQUARE = torch.tensor([[(-1.0, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1.0, -1, 0), (1, 1, 0), (-1, 1, 0)]])


@pytest.fixture(scope="module")
def network():
    return busy_network()


@pytest.fixture
def scene():
    return scene_light(floor_scene())


@pytest.fixture
def view(network, scene):
    return guided_view(replace(scene, radiosity=None), *floor_view(), network.config)


def bundle(position, normal=(0.0, 0, 1), toward=(0.0, 0, 0), nearness=0.0) -> Bundles:
    """One, lit by one emitter."""
    emitters = torch.zeros(1, 1, 3, len(EMITTER))
    emitters[0, 0, 0, EMITTER["toward"]], emitters[0, 0, 0, EMITTER["nearness"]] = torch.tensor(toward), nearness
    return Bundles(torch.randn(1, 1, WIDTH), torch.tensor([[position]]), torch.tensor([[normal]]), emitters,
                   torch.ones(1, 1, 1))


def surfaces(corners: torch.Tensor, front=(0.0, 0, 0), back=(0.0, 0, 0)) -> Surfaces:
    count = len(corners)
    return Surfaces(torch.randn(1, count, WIDTH), corners[None],
                    torch.tensor([front, back]).expand(1, count, 2, 3), torch.ones(1, count, dtype=torch.bool))


@torch.no_grad()
def found(heads, bundles: Bundles, some: Surfaces) -> torch.Tensor:
    return heads(bundles, some, *heads.keys(some))[0, 0]


@torch.no_grad()
def weights(heads, bundles: Bundles, some: Surfaces, monkeypatch) -> torch.Tensor:
    """(heads, L + 1) of the triangles, and of nothing."""
    seen, real = [], type(heads).weights
    monkeypatch.setattr(type(heads), "weights", lambda *a: seen.append(real(*a)) or seen[-1])
    found(heads, bundles, some)
    return torch.cat(seen[-1], -1)[0, :, 0]


def test_before_training_a_bundle_gathers_by_form_factors(monkeypatch):
    """A square that fills a known share of the hemisphere, seen from far enough to be a point."""
    heads = GatheringHeads(WIDTH)
    above = bundle((0.0, 0, -6), (0.0, 0, 1))
    share = weights(heads, above, surfaces(SQUARE), monkeypatch)
    expected = 4 / (torch.pi * 36 + 4)
    torch.testing.assert_close(share[:, :2].sum(1), torch.full((GATHERING,), expected), atol=3e-3, rtol=0.05)
    behind = weights(heads, bundle((0.0, 0, -6), (0.0, 0, -1)), surfaces(SQUARE), monkeypatch)
    assert (behind[:, 2] > 0.999).all()


def test_the_side_that_is_seen_sends_the_light():
    heads, front, back = GatheringHeads(WIDTH), (3.0, 0.0, 0.0), (0.0, 5.0, 0.0)
    red, green = (found(heads, bundle((0.0, 0, z), (0.0, 0, -z)), surfaces(SQUARE, front, back)) for z in (1.0, -1.0))
    light = slice(len(red) // GATHERING - 3, len(red) // GATHERING)
    assert red[light][0] > 0.2 and red[light][1] == 0
    assert green[light][1] > 0.2 and green[light][0] == 0


@pytest.mark.parametrize(("x", "z", "blocks"), [
    (0.0, 0.0, True), (0.9, 0.0, True), (-0.9, 0.0, True),
    (1.5, 0.0, False),   # beside it
    (0.0, 1.5, False),   # below its plane, and so is the emitter
    (0.0, -1.5, False),  # beyond the emitter
])
def test_what_stands_between_hides_the_emitter(x, z, blocks, monkeypatch):
    """An emitter one unit above a point half a unit below the square, or elsewhere."""
    lit = bundle((0.0, 0, -0.5), toward=(0.0, 0, 1.0), nearness=1 / (1 + 1.0))
    moved = SQUARE + torch.tensor([x, 0, -z])
    share = weights(ShadowHeads(WIDTH), lit, surfaces(moved), monkeypatch)[:, -1]
    assert (share < 0.4).all() if blocks else (share > 0.95).all()


@torch.no_grad()
def test_content_can_open_what_geometry_closes():
    heads, lit = ShadowHeads(WIDTH), bundle((0.0, 0, -0.5), toward=(0.0, 0, 1.0), nearness=0.5)
    square = surfaces(SQUARE)
    before = found(heads, lit, square)
    torch.nn.init.normal_(heads.q_proj.weight)
    assert (found(heads, lit, square) - before).abs().max() > 1e-2


def test_bundles_look_at_the_emitter_of_their_pixels(view):
    emitters = bundle_emitters(view.emitters, 8)
    toward, length = line_to(emitters[0, :, 0])
    lamp = torch.tensor([0.0, -0.03, 2.0])
    lit = emitters[0, :, 0, EMITTER["share"]].amax(-1) > 0.9
    torch.testing.assert_close((view.positions[0] + toward * length[:, None])[lit], lamp.expand(int(lit.sum()), 3),
                               atol=0.06, rtol=0)
    assert lit.sum() > 20


def test_triangles_send_on_what_arrives_without_shadows_and_nothing_is_told_with_rays(network, scene):
    inputs = guided_inputs(floor_scene(), network.config, load_material_mapper(), scene.direct)
    floor = inputs.sent[~inputs.is_light]
    assert (floor[:, 0] > 0).all() and (floor[:, 1] == 0).all()  # the lamp is above
    assert (floor[:, 0, 0] > floor[:, 0, 2]).all()  # it is orange
    assert not guided_inputs(floor_scene(), network.config, load_material_mapper()).sent.any()


@torch.no_grad()
def test_pieces_give_what_the_whole_gives_and_light_by_rays_does_without(network, scene, view, monkeypatch):
    context = network.encode_scene(guided_inputs(floor_scene(), network.config, load_material_mapper(), scene.direct))
    whole = network.ray_tokens(context, view)
    assert (whole - network.embed_rays(view)).abs().max() > 1e-3
    monkeypatch.setattr(light_attention, "PAIRS", 10 * len(floor_scene()))
    with inference():
        torch.testing.assert_close(network.ray_tokens(context, view), whole, atol=1e-4, rtol=1e-4)
    with_rays = guided_view(scene, *floor_view(), network.config)
    assert torch.equal(network.ray_tokens(context, with_rays), network.embed_rays(with_rays))
