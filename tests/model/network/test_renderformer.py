# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets and behaviours of the whole network."""
from dataclasses import replace

import pytest
import torch

from renderformer_v2.model import progress
from renderformer_v2.model.compute import inference as inference_module
from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.guided.network import new_network
from renderformer_v2.model.network import attention, decoder, renderformer
from renderformer_v2.model.network.inputs import ViewInputs
from renderformer_v2.model.network.layers import store_in_precision
from renderformer_v2.model.network.renderformer import RenderFormer
from renderformer_v2.model.weights.presets import rf2_200m, rf2_small


def meta(config) -> RenderFormer:
    with torch.device("meta"):
        return new_network(config)


def test_published_preset_has_the_published_size():
    state = meta(rf2_200m()).state_dict()
    assert len(state) == 321 and sum(v.numel() for v in state.values()) == 207_578_027


def test_guidance_adds_to_the_published_keys_and_takes_none_away_but_the_decoder():
    small = rf2_small()
    paper = replace(small, guidance=None)
    kept = {key for key in meta(paper).state_dict() if not key.startswith("view_transformer.out_dpt.")}
    assert kept < set(meta(small).state_dict())
    assert not any("guid" in key or "tile_encoder" in key for key in meta(paper).state_dict())


@inference()
def test_order_of_the_triangles_does_not_matter(tiny_network, tiny_inputs, rays):
    order = torch.randperm(len(tiny_inputs.light), generator=torch.Generator().manual_seed(3))
    shuffled = replace(tiny_inputs, **{name: getattr(tiny_inputs, name)[order]
                                       for name in ("triangles", "normals", "texture_index", "light")})
    torch.testing.assert_close(tiny_network(shuffled, rays), tiny_network(tiny_inputs, rays), atol=1e-5, rtol=1e-5)


@inference()
def test_moving_scene_and_camera_together_changes_nothing(tiny_network, tiny_inputs, rays):
    shift = torch.tensor([0.5, -0.25, 1.0])
    volumes = replace(tiny_inputs.volumes, position=tiny_inputs.volumes.position + shift)
    moved = replace(tiny_inputs, triangles=tiny_inputs.triangles + shift, volumes=volumes)
    image = tiny_network(tiny_inputs, rays)
    along = tiny_network(moved, replace(rays, origin=rays.origin + shift))
    torch.testing.assert_close(along, image, atol=1e-4, rtol=1e-4)
    assert not torch.allclose(tiny_network(moved, rays), image, atol=1e-4)


@inference()
def test_views_are_independent_and_a_context_is_reusable(tiny_network, tiny_inputs, rays):
    both = tiny_network(tiny_inputs, rays)
    context = tiny_network.encode_scene(tiny_inputs)
    for i in range(2):
        one = tiny_network.render_view(context, ViewInputs(rays.origin[[i]], rays.directions[[i]]))
        torch.testing.assert_close(one[0], both[i], atol=1e-5, rtol=1e-5)
    assert len(context.keys_values) == 4
    lean = tiny_network.encode_scene(tiny_inputs, cache_keys_values=False)
    torch.testing.assert_close(tiny_network.render_view(lean, rays), both)
    assert not lean.keys_values


@inference()
def test_a_view_in_bands_is_the_same_view(tiny_network, tiny_inputs, monkeypatch):
    context = tiny_network.encode_scene(tiny_inputs)
    directions = torch.nn.functional.normalize(torch.randn(2, 192, 128, 3), dim=-1)
    view = ViewInputs(torch.zeros(2, 3), directions)
    expected = tiny_network.render_view(context, view)
    for module, name, small in ((attention, "TOKENS", 1), (attention, "WINDOWS", 3),
                                (decoder, "BAND_PIXELS", 2 * 128 * 40), (inference_module, "CHUNK", 100)):
        monkeypatch.setattr(module, name, small)
    torch.testing.assert_close(tiny_network.render_view(context, view), expected, atol=1e-6, rtol=1e-5)


@inference()
def test_what_stage_two_keeps_of_a_scene_is_bounded(tiny_network, tiny_inputs, rays, monkeypatch):
    small = tiny_network.encode_scene(tiny_inputs)
    tiny_network.render_view(small, rays)
    kept = sum(keys.bytes for keys in small.keys_values.values())
    assert kept == tiny_network.keys_values_bytes(len(small.tokens))
    monkeypatch.setattr(renderformer, "KEYS_VALUES_BYTES", kept - 1)
    assert not tiny_network.encode_scene(tiny_inputs).caches


@inference()
def test_a_scene_of_lights_only_and_an_empty_scene_run(tiny_network, tiny_inputs, rays):
    lit = replace(tiny_inputs, light=torch.ones(50, 3), volumes=None)
    context = tiny_network.encode_scene(lit)
    assert context.sink == len(context.tokens)
    rows = {name: getattr(tiny_inputs, name)[:0] for name in ("triangles", "normals", "texture_index", "light")}
    empty = replace(tiny_inputs, volumes=None, **rows)
    assert tiny_network(empty, rays).isfinite().all()


@pytest.mark.parametrize("changes", [
    {"dense": True}, {"light_sinks": False}, {"summaries": False}, {"summary_block_size": 7}, {"sinks": False},
    {"local_attention_window_size_half": 9}, {"local_attention_window_size_half": 0},
    {"dense": True, "light_sinks": False, "summaries": False}])
def test_ablations_have_the_same_weights_and_another_picture(tiny_network, tiny_inputs, rays, changes):
    other = RenderFormer(replace(tiny_network.config, **changes).validate()).requires_grad_(False).eval()
    other.load_state_dict(tiny_network.state_dict())
    with inference():
        context, usual = other.encode_scene(tiny_inputs), tiny_network.encode_scene(tiny_inputs)
        pictures = [network.render_view(it, rays) for network, it in ((other, context), (tiny_network, usual))]
    lights = int(tiny_inputs.is_light.sum())
    others = len(tiny_inputs.light) - lights + len(tiny_inputs.volumes.density)
    assert len(context.tokens) == other.config.sequence_length(lights, others)
    if other.config.sinks:
        assert len(context.tokens) - context.sink == others + (0 if other.config.light_sinks else lights)
    else:
        assert context.sink == 0
    assert pictures[0].isfinite().all() and not torch.allclose(*pictures)


def test_odd_sizes_are_refused_with_the_numbers(tiny_network, tiny_inputs):
    with pytest.raises(ValueError, match="72 x 64"):
        tiny_network(tiny_inputs, ViewInputs(torch.zeros(1, 3), torch.ones(1, 64, 72, 3)))


@inference()
def test_bfloat16_weights_give_nearly_the_same_picture(tiny_config, tiny_network, tiny_inputs, rays):
    half = RenderFormer(tiny_config)
    half.load_state_dict(tiny_network.state_dict())
    half = store_in_precision(half, torch.bfloat16).eval()
    assert half.transformer.rope_emb.freqs.dtype == torch.float32
    expected = tiny_network(tiny_inputs, rays)
    error = (half(tiny_inputs, rays) - expected).pow(2).mean().sqrt() / expected.abs().max()
    assert error < 10 ** (-40 / 20)


def test_gradients_reach_every_parameter(tiny_config, tiny_inputs, rays):
    torch.manual_seed(0)
    network = RenderFormer(tiny_config)
    network(tiny_inputs, rays).square().mean().backward()
    silent = [name for name, p in network.named_parameters()
              if p.requires_grad and (p.grad is None or not p.grad.any())]
    assert silent == []


def test_progress_names_the_stages_and_never_goes_back(tiny_network, tiny_inputs, rays):
    seen = []
    with inference(), progress.reporting(lambda *said: seen.append(said)):
        with progress.part(0.0, 0.5):
            context = tiny_network.encode_scene(tiny_inputs)
        with progress.part(0.5, 1.0):
            tiny_network.render_view(context, rays)
    assert {"Spreading light, 2 of 2", "Gathering light, 4 of 4", "Painting the picture"} <= {text for text, _ in seen}
    fractions = [fraction for _, fraction in seen]
    assert fractions == sorted(fractions) and 0 <= fractions[0] and fractions[-1] <= 1
