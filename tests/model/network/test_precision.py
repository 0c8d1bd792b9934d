# SPDX-License-Identifier: GPL-3.0-or-later
"""Which parts of a network are stored in half precision."""
import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.network import attention, decoder, renderformer
from renderformer_v2.model.network.memory_estimate import count_view_parameters
from renderformer_v2.model.network.renderformer import RenderFormer, store_as_released
from renderformer_v2.model.weights.presets import rf2_200m
from tools.parity.cases import recipe_network


@inference()
def test_stage_2_is_as_exact_as_in_the_authors_release(tiny_config, tiny_inputs, rays, monkeypatch):
    context = recipe_network(tiny_config).encode_scene(tiny_inputs, cache_keys_values=False)

    def features(exact: bool, dtype: torch.dtype):
        monkeypatch.setattr(renderformer, "has_tensor_float_32", lambda device: exact)
        network, seen = store_as_released(recipe_network(tiny_config), dtype, torch.device("cpu")).eval(), []
        network.view_transformer.out_dpt.register_forward_pre_hook(lambda module, given: seen.extend(given[0]))
        assert network.render_view(context, rays).isfinite().all()
        return torch.stack(seen), {name: weight.dtype for name, weight in network.named_parameters()}

    expected, _ = features(False, torch.float32)
    assert torch.equal(features(True, torch.float32)[0], expected)
    mixed, found = features(True, torch.bfloat16)
    assert found["view_transformer.out_dpt.projects.0.weight"] == torch.bfloat16
    assert found["transformer.layers.0.multihead_attn.in_proj.weight"] == torch.bfloat16
    assert {found[name] for name in found if name.startswith("view_transformer.transformer")} == {torch.float32}
    error, of_all = ((x - expected).square().mean().sqrt() / expected.abs().max()
                     for x in (mixed, features(False, torch.bfloat16)[0]))
    assert 0 < error < 10 ** (-60 / 20) < of_all  # of bfloat16 in the products of cross-attention alone


@pytest.mark.parametrize("exact", [False, True])
@inference()
def test_cross_attention_in_stage_2_is_in_the_renders_precision(tiny_config, tiny_inputs, rays, monkeypatch, exact):
    """Float32 would keep it from Flash."""
    monkeypatch.setattr(renderformer, "has_tensor_float_32", lambda device: exact)
    network, seen = store_as_released(recipe_network(tiny_config), torch.bfloat16, torch.device("cpu")).eval(), set()
    monkeypatch.setattr(attention, "attend_to_all", lambda q, keys, real=attention.attend_to_all: seen.update(
        x.dtype for x in (q, keys.blocks[0].keys, keys.blocks[0].values)) or real(q, keys))
    context = network.encode_scene(tiny_inputs)
    network.render_view(context, rays)
    assert seen == {torch.bfloat16}
    assert network.keys_values_bytes(len(context.tokens)) == sum(keys.bytes for keys in context.keys_values.values())


def test_the_weights_of_stage_2_are_counted():
    with torch.device("meta"):
        layers = RenderFormer(rf2_200m()).view_transformer.transformer.layers
    counted = sum(p.numel() for p in layers.parameters() if p.ndim == 2)
    assert count_view_parameters(rf2_200m()) == counted


@pytest.mark.parametrize("bands", [False, True])
def test_the_last_convolution_is_never_computed_in_tensor_float_32(tiny_config, tiny_network, monkeypatch, bands):
    """On a card it would be, as all others are, unless PyTorch is told otherwise around it."""
    last, settings, real = tiny_network.view_transformer.out_dpt.scratch.output_conv2[-1], [], F.conv2d

    def watched(x, weight, *rest):
        settings.append((weight is last.weight, x.dtype, torch.backends.cudnn.conv.fp32_precision))
        return real(x, weight, *rest)

    monkeypatch.setattr(F, "conv2d", watched)
    monkeypatch.setattr(decoder, "BAND_PIXELS", 64 * 16 if bands else 64 * 64)
    before = torch.backends.cudnn.conv.fp32_precision
    with inference():
        tiny_network.view_transformer.out_dpt([torch.randn(1, 48, 8, 8, dtype=torch.bfloat16)] * 4)
    assert before != "ieee" and torch.backends.cudnn.conv.fp32_precision == before
    assert {(dtype, setting) for is_last, dtype, setting in settings if is_last} == {(torch.float32, "ieee")}
    assert {setting for is_last, _, setting in settings if not is_last} == {before}
    assert sum(is_last for is_last, *_ in settings) == (4 if bands else 1)
