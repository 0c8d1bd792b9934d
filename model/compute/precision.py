# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the number format by the hardware."""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import torch
from torch.nn import functional as F

PRECISIONS = {"fp32": torch.float32, "bf16": torch.bfloat16, "fp16": torch.float16}
CHOICES = ("auto", *PRECISIONS)
NAMES = {torch.float32: "Float32", torch.bfloat16: "BFloat16", torch.float16: "Float16"}  # as the settings call them
TRIED = 64  # width of the tensors that `find_failure` tries: the least that fills matrix units


def choose_precision(name: str, device: torch.device) -> torch.dtype:
    """`auto` takes half precision where the device says that it has it, so that a machine always takes the same.

    Raises ValueError for a format that the device does not have.
    """
    if name != "auto":
        if name == "fp16" and device.type == "cpu":
            raise ValueError("fp16 needs a GPU: choose the precision Automatic, fp32 or bf16")
        return PRECISIONS[name]
    if device.type == "cuda":
        return cuda_precision(torch.cuda.get_device_capability(device))
    return torch.float16 if device.type == "mps" else processor_precision(torch.cpu.get_capabilities())


def processor_precision(capabilities: Mapping) -> torch.dtype:
    """bfloat16 with AMX, and with AVX512-BF16 on AMD's processors: twice as fast as float32 and more.

    Intel's with AVX512-BF16 but without AMX, as virtual machines hide it, take 1.6 times as long as in float32. Others
    compute it bit by bit, up to 500 times slower. capabilities: as torch.cpu.get_capabilities() gives them.
    """
    is_intel = "Intel" in capabilities.get("cpu_name", "")
    return torch.bfloat16 if capabilities.get("amx_bf16" if is_intel else "avx512_bf16") else torch.float32


def cuda_precision(capability: tuple[int, int]) -> torch.dtype:
    """bfloat16 from Ampere on (8.0), float16 on Volta and Turing (7.0): what their matrix units multiply."""
    return torch.bfloat16 if capability >= (8, 0) else torch.float16 if capability >= (7, 0) else torch.float32


def find_failure(dtype: torch.dtype, device: torch.device) -> str:
    """Why the operators that the network needs in this format fail on a device that should have it; "" if they work.

    Builds of PyTorch differ, and so do the libraries that they load.
    """
    x = torch.ones(1, TRIED, TRIED, device=device, dtype=dtype)
    try:
        with torch.inference_mode():
            attended = F.scaled_dot_product_attention(*[F.linear(x, x[0])[None]] * 3, attn_mask=torch.zeros_like(x[0]))
            picture = F.conv2d(attended, x[0, :1].view(1, 1, 8, 8), padding=1)
            F.conv_transpose2d(picture, x[0, :1, :16].view(1, 1, 4, 4), stride=4).float().sum().item()
    except (RuntimeError, TypeError) as error:
        return str(error).strip().partition("\n")[0]
    return ""


def has_tensor_float_32(device: torch.device) -> bool:
    """Whether the device multiplies float32 in TensorFloat-32, fast and with 10 bits of mantissa: from Ampere on."""
    return device.type == "cuda" and not torch.version.hip and torch.cuda.get_device_capability(device) >= (8, 0)


@contextmanager
def tensor_float_32(device: torch.device) -> Iterator[None]:
    """Inside, a device that has TensorFloat-32 multiplies matrices of float32 in it."""
    if not has_tensor_float_32(device):
        yield
        return
    settings = torch.backends.cuda.matmul
    before = settings.allow_tf32
    settings.allow_tf32 = True
    try:
        yield
    finally:
        settings.allow_tf32 = before


@contextmanager
def exact_float_32() -> Iterator[None]:
    """Inside, convolutions of float32 use all its bits, which on cards from Ampere on they do not by default."""
    convolutions = getattr(torch.backends.cudnn, "conv", None)  # PyTorch 2.9 has a setting for them by themselves
    settings, name, exact = ((convolutions, "fp32_precision", "ieee") if hasattr(convolutions, "fp32_precision") else
                             (torch.backends.cudnn, "allow_tf32", False))
    before = getattr(settings, name)
    setattr(settings, name, exact)
    try:
        yield
    finally:
        setattr(settings, name, before)
