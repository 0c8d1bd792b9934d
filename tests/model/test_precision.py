# SPDX-License-Identifier: GPL-3.0-or-later
"""The number format by what a device says of itself: the same in every process, whatever else the machine does."""
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from renderformer_v2.model import precision
from renderformer_v2.model.network.footprint import view_parameters
from renderformer_v2.model.network.renderformer import RenderFormer
from renderformer_v2.model.precision import (
    as_released,
    choose_precision,
    has_tensor_float_32,
    of_cuda,
    of_processor,
    tensor_float_32,
)
from renderformer_v2.model.presets import rf2_200m
from tools.parity.cases import recipe_network


@pytest.mark.parametrize("capabilities, expected", [
    ({"architecture": "x86_64", "avx2": True, "avx512_f": False, "avx512_bf16": False}, torch.float32),
    ({"architecture": "x86_64", "avx2": True, "avx512_f": True, "avx512_bf16": False}, torch.float32),
    ({"architecture": "x86_64", "avx512_f": True, "avx512_bf16": True, "amx_bf16": False}, torch.bfloat16),
    ({"architecture": "x86_64", "avx512_f": True, "avx512_bf16": True, "amx_bf16": True}, torch.bfloat16),
    ({"architecture": "aarch64", "neon": True, "bf16": True}, torch.float32)],
    ids=["Zen 3", "Ice Lake", "Zen 5", "Sapphire Rapids", "Apple M2"])
def test_processors_that_multiply_bfloat16_themselves_take_it(capabilities, expected):
    assert of_processor(capabilities) == expected


@pytest.mark.parametrize("capability, expected", [
    ((6, 1), torch.float32), ((7, 0), torch.float16), ((7, 5), torch.float16), ((8, 0), torch.bfloat16),
    ((12, 0), torch.bfloat16)], ids=["Pascal", "Volta", "Turing", "Ampere", "Blackwell"])
def test_gpus_take_what_their_matrix_units_multiply(capability, expected):
    assert of_cuda(capability) == expected


def test_apple_gpus_take_float16():
    assert choose_precision("auto", torch.device("mps")) == torch.float16


def test_the_processor_is_asked_and_not_measured():
    class Refused(TorchDispatchMode):
        def __torch_dispatch__(self, func, types, args=(), kwargs=None):
            raise AssertionError(f"{func} was computed")

    with Refused():
        chosen = choose_precision("auto", torch.device("cpu"))
    assert chosen == of_processor(torch.cpu.get_capabilities())


@pytest.mark.parametrize("capability, expected", [((7, 5), False), ((8, 0), True), ((8, 6), True), ((12, 0), True)])
def test_cards_from_ampere_on_have_tensor_float_32(capability, expected, monkeypatch):
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda device: capability)
    card, before = torch.device("cuda", 0), torch.backends.cuda.matmul.allow_tf32
    assert has_tensor_float_32(card) == expected and not has_tensor_float_32(torch.device("cpu"))
    with tensor_float_32(card):
        assert torch.backends.cuda.matmul.allow_tf32 == (expected or before)
    assert torch.backends.cuda.matmul.allow_tf32 == before


@torch.inference_mode()
def test_stage_2_is_as_exact_as_in_the_authors_release(tiny_config, tiny_inputs, rays, monkeypatch):
    context = recipe_network(tiny_config).encode_scene(tiny_inputs, keep_keys_values=False)

    def features(exact: bool, dtype: torch.dtype):
        monkeypatch.setattr(precision, "has_tensor_float_32", lambda device: exact)
        network, seen = as_released(recipe_network(tiny_config), dtype, torch.device("cpu")).eval(), []
        network.view_transformer.out_dpt.register_forward_pre_hook(lambda module, given: seen.extend(given[0]))
        assert network.render_view(context, rays).isfinite().all()
        return torch.stack(seen), {name: weight.dtype for name, weight in network.named_parameters()}

    expected, _ = features(False, torch.float32)
    mixed, found = features(True, torch.bfloat16)
    torch.testing.assert_close(mixed, expected, rtol=0, atol=0)
    assert not torch.equal(features(False, torch.bfloat16)[0], expected)
    assert found["view_transformer.out_dpt.projects.0.weight"] == torch.bfloat16
    assert found["transformer.layers.0.multihead_attn.in_proj.weight"] == torch.bfloat16


def test_the_weights_of_stage_2_are_counted():
    with torch.device("meta"):
        layers = RenderFormer(rf2_200m()).view_transformer.transformer.layers
    counted = sum(p.numel() for p in layers.parameters() if p.ndim == 2)
    assert view_parameters(rf2_200m()) == counted
