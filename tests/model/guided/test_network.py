# SPDX-License-Identifier: GPL-3.0-or-later
"""Guidance changes light tokens, ray tokens and pixels, and nothing else; the bundled weights do without all of it."""
from dataclasses import replace

import pytest
import torch

from renderformer_v2.model.guided.decoding import OUTPUTS
from renderformer_v2.model.guided.features import guided_view
from renderformer_v2.model.guided.guided_inputs import guided_inputs
from renderformer_v2.model.guided.network import GuidedRenderFormer, load_network
from renderformer_v2.model.material.mappers import load_material_mapper
from renderformer_v2.model.network.renderformer import RenderFormer
from renderformer_v2.model.weights.presets import BUNDLED, rf2_small, weights_folder
from tests.model.guided.weights import busy_network
from tests.model.samples import floor_scene, floor_view, scene_light


@pytest.fixture(scope="module")
def network():
    return busy_network()


@pytest.fixture
def inputs(network):
    return guided_inputs(floor_scene(), network.config, load_material_mapper())


@pytest.fixture
def view(network):
    return guided_view(scene_light(floor_scene()), *floor_view(), network.config)


@torch.no_grad()
def test_a_beam_changes_the_light_tokens_alone(network, inputs):
    plain = network.embed_triangles(inputs)
    axis = torch.tensor([[0.0, 0.0, -1.0]])
    beamed = network.embed_triangles(replace(inputs, beam_axis=axis, beam_cosine=torch.tensor([[0.5, 0.9]])))
    changed = (plain != beamed).any(dim=-1)
    assert torch.equal(changed, inputs.is_light) and changed.any()


@torch.no_grad()
def test_ray_tokens_are_where_they_hit_and_know_what(network, view):
    assert torch.equal(network.ray_positions(view), view.positions)
    paper = RenderFormer.embed_rays(network, view)
    torch.testing.assert_close(network.embed_rays(view) - paper, network.guidance.bundles(view))


@torch.no_grad()
def test_pixels_are_channels_of_light(network, inputs, view):
    raw = network.render_view(network.encode_scene(inputs), view)
    assert raw.shape == (1, len(OUTPUTS), 64, 64) and raw.isfinite().all()


def test_inputs_without_a_mapper_hold_the_parameters(network):
    parameters = guided_inputs(floor_scene(), network.config).texture
    torch.testing.assert_close(parameters[0, :3, 0, 0], torch.tensor([0.8, 0.5, 0.2]), atol=1e-3, rtol=0)


def test_emitters_look_to_the_network_as_in_training_whatever_they_reflect(network):
    scene = floor_scene()
    inputs = guided_inputs(scene, network.config)
    of_triangles = inputs.texture[inputs.texture_index]
    assert (of_triangles[scene.is_light, :3] == 1).all() and (of_triangles[~scene.is_light, :3] < 1).all()


def test_the_bundled_weights_are_of_the_whole_network_and_small():
    folder = weights_folder(BUNDLED)
    loaded = load_network(folder)
    assert isinstance(loaded, GuidedRenderFormer) and loaded.config == rf2_small()
    assert all(p.isfinite().all() for p in loaded.state_dict().values())
    assert any(p.any() for p in loaded.pixel_decoder.leave.parameters())
    assert (folder / "model.safetensors").stat().st_size < 20e6
