# SPDX-License-Identifier: GPL-3.0-or-later
"""The number format by what a device says of itself: the same in every process, whatever else the machine does."""
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from renderformer_v2.model.compute.precision import (
    choose_precision,
    cuda_precision,
    has_tensor_float_32,
    processor_precision,
    tensor_float_32,
)


@pytest.mark.parametrize("capabilities, expected", [
    ({"architecture": "x86_64", "avx2": True, "avx512_f": False, "avx512_bf16": False}, torch.float32),
    ({"architecture": "x86_64", "avx2": True, "avx512_f": True, "avx512_bf16": False}, torch.float32),
    ({"cpu_name": "AMD Ryzen 9 9950X", "avx512_f": True, "avx512_bf16": True, "amx_bf16": False}, torch.bfloat16),
    ({"cpu_name": "Intel Xeon", "avx512_f": True, "avx512_bf16": True, "amx_bf16": True}, torch.bfloat16),
    ({"cpu_name": "Intel Xeon", "avx512_f": True, "avx512_bf16": True}, torch.float32),
    ({"architecture": "aarch64", "neon": True, "bf16": True}, torch.float32)],
    ids=["Zen 3", "Ice Lake", "Zen 5", "Sapphire Rapids", "Sapphire Rapids without AMX", "Apple M2"])
def test_processors_that_multiply_bfloat16_themselves_take_it(capabilities, expected):
    assert processor_precision(capabilities) == expected


@pytest.mark.parametrize("capability, expected", [
    ((6, 1), torch.float32), ((7, 0), torch.float16), ((7, 5), torch.float16), ((8, 0), torch.bfloat16),
    ((12, 0), torch.bfloat16)], ids=["Pascal", "Volta", "Turing", "Ampere", "Blackwell"])
def test_gpus_take_what_their_matrix_units_multiply(capability, expected):
    assert cuda_precision(capability) == expected


def test_apple_gpus_take_float16():
    assert choose_precision("auto", torch.device("mps")) == torch.float16


def test_the_processor_is_asked_and_not_measured():
    class Refused(TorchDispatchMode):
        def __torch_dispatch__(self, func, types, args=(), kwargs=None):
            raise AssertionError(f"{func} was computed")

    with Refused():
        chosen = choose_precision("auto", torch.device("cpu"))
    assert chosen == processor_precision(torch.cpu.get_capabilities())


@pytest.mark.parametrize("capability, expected", [((7, 5), False), ((8, 0), True), ((8, 6), True), ((12, 0), True)])
def test_cards_from_ampere_on_have_tensor_float_32(capability, expected, monkeypatch):
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda device: capability)
    card, before = torch.device("cuda", 0), torch.backends.cuda.matmul.allow_tf32
    assert has_tensor_float_32(card) == expected and not has_tensor_float_32(torch.device("cpu"))
    with tensor_float_32(card):
        assert torch.backends.cuda.matmul.allow_tf32 == (expected or before)
    assert torch.backends.cuda.matmul.allow_tf32 == before
